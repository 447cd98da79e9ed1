"""Where networks compute: as Lightning trains, unless `device` says otherwise. A GPU is not needed to see what is asked for."""

from dataclasses import replace

import pytest
import torch
from training_toys import tiny_settings

pytest.importorskip("embreex")

from hilbertvae.checks import InputError  # noqa: E402
from hilbertvae.mappers.hilbert_map import HilbertMap  # noqa: E402
from hilbertvae.mappers.octomap_mapper import OctoMapMapper  # noqa: E402
from hilbertvae.reconstruction.reconstructor import Reconstructor  # noqa: E402
from hilbertvae.training.devices import filling_device, training_device  # noqa: E402
from hilbertvae.training.given_networks import give_networks  # noqa: E402
from hilbertvae.training.train import train  # noqa: E402
from toy_rooms import tiny_reconstructor  # noqa: E402

THERE = [("auto", "cuda"), ("gpu", "cuda"), ("cuda", "cuda"), ("cpu", "cpu")]


@pytest.mark.parametrize(
    ("accelerator", "there", "expected"), [*((a, True, e) for a, e in THERE), ("auto", False, "cpu"), ("gpu", False, "cuda")]
)
def test_maps_are_filled_where_networks_train(tmp_path, monkeypatch, accelerator, there, expected):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: there)
    settings = tiny_settings(tmp_path, tmp_path)
    settings = replace(settings, trainer=replace(settings.trainer, accelerator=accelerator))
    assert training_device(settings) == filling_device(settings) == expected
    assert filling_device(replace(settings, device="cpu")) == "cpu"


@pytest.mark.parametrize("accelerator", ["auto", "gpu", "mps"])
def test_maps_are_filled_by_the_cpu_of_an_apple_gpu(tmp_path, monkeypatch, accelerator):
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    settings = tiny_settings(tmp_path, tmp_path)
    settings = replace(settings, trainer=replace(settings.trainer, accelerator=accelerator))
    assert training_device(settings) == "mps" and filling_device(settings) == "cpu"


@pytest.mark.parametrize(
    "wrong", [{"accelerator": "gpu"}, {"accelerator": "cuda"}, {"strategy": "dpp"}, {"strategy": "ddp_spawn"}, {"strategy": "fsdp"}]
)
def test_where_nothing_can_train(tmp_path, monkeypatch, wrong):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    settings = tiny_settings(tmp_path / "run", tmp_path)
    (key,) = wrong
    with pytest.raises(InputError, match=f"trainer.{key}: expected"):
        train(replace(settings, trainer=replace(settings.trainer, **wrong)))
    assert not (tmp_path / "run").exists()


def test_weights_and_scores_are_found_on_the_device_of_the_run(tmp_path, monkeypatch):
    """`cpu:0` is the CPU under a name that no default has."""
    asked = []
    complete = Reconstructor.complete

    def seen(self, grids, flips=4, batch=64, device="cpu", progress=None):
        asked.append(device)
        return complete(self, grids, flips, batch, device, progress)

    monkeypatch.setattr(Reconstructor, "complete", seen)
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache", device="cpu:0")
    settings = replace(settings, data=replace(settings.data, test=["simulated:900002"]))
    results = []
    mappers = {"ours": HilbertMap("trained", device="auto"), "others": HilbertMap("trained", device="auto", neighbours=2)}
    train(settings, mappers, lambda result, site, fitted: results.append(result))
    assert len(asked) > 4 and set(asked) == {"cpu:0"} and not results[0].failed


def test_a_mapper_may_have_a_device_of_its_own(tmp_path):
    settings = tiny_settings(tmp_path, tmp_path, device="cpu:0")
    given = give_networks(
        settings, {"ours": HilbertMap("trained", device="cpu"), "run": HilbertMap("trained", device="auto")}, tiny_reconstructor()
    )
    assert (given["ours"].device, given["run"].device) == ("cpu", "cpu:0")


def test_a_device_that_is_not_there_is_named_before_anything_trains(tmp_path):
    with pytest.raises(InputError, match="device: expected cpu, or cuda where there is one, got 'tpu'"):
        train(tiny_settings(tmp_path / "run", tmp_path, device="tpu"))
    assert not (tmp_path / "run").exists()


def test_maps_of_raw_grids_keep_voxels_of_their_own(tmp_path):
    given = give_networks(tiny_settings(tmp_path, tmp_path), {"own": HilbertMap(resolution_m=0.2), "run": HilbertMap()}, None)
    assert (given["own"].resolution_m, given["run"].resolution_m) == (0.2, 0.1)


def test_two_rows_of_one_name_are_refused(tmp_path):
    """The run's network has no sampling, so that its row is named as the other's is."""
    mappers = {"cvae-hm": HilbertMap("trained"), "cae-hm": HilbertMap(tiny_reconstructor(seed=4))}
    with pytest.raises(InputError, match="mapper.cae-hm: expected one mapper of that name"):
        give_networks(tiny_settings(tmp_path, tmp_path), mappers, tiny_reconstructor(variational=False))
    assert [*give_networks(tiny_settings(tmp_path, tmp_path), mappers, tiny_reconstructor())] == ["cvae-hm", "cae-hm"]


def test_mappers_that_are_given_stay_as_they_are(tmp_path):
    """Else a second run would score the network, the voxels and the grids of the first with them."""
    mappers = {"ours": HilbertMap("trained", device="auto"), "raw": HilbertMap(device="auto"), "octomap": OctoMapMapper()}
    before = {name: mapper.get_params(deep=False) for name, mapper in mappers.items()}
    first, second = (tiny_reconstructor(seed=seed) for seed in (3, 4))
    settings = tiny_settings(tmp_path, tmp_path)
    assert give_networks(settings, mappers, first)["ours"].reconstructor is first
    assert give_networks(settings, mappers, second)["ours"].reconstructor is second
    assert {name: mapper.get_params(deep=False) for name, mapper in mappers.items()} == before
