import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from stopping_toys import let_the_first_epoch_be_the_best
from training_toys import TRAINER, tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.files import file_sha256
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import GatedNetworkSettings
from hilbertvae.training.checkpoints import best_reconstructor
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.train import _precision, train
from toy_rooms import carmen_line, write_log

pytest.importorskip("embreex")
pytest.importorskip("shapely")


def test_a_run_leaves_a_checkpoint_that_maps(finished, room):
    settings, path = finished
    assert str(path) == f"{settings.output}/model.safetensors"
    found = Reconstructor.load(path)
    assert (found.grid, found.network_settings, found.resolution_m) == (settings.grid, settings.network, 0.1)
    assert set(found.map_weights) == {"points", "voxels"} and found.card["trained_on"] == ["1 simulated buildings"]
    mapper = HilbertMap(found).fit(room.fit.points, room.fit.occupied, room.fit.weight)
    assert np.isfinite(mapper.predict_proba(room.voxels.points)).all()


def test_the_card_says_what_lay_at_the_paths_it_was_trained_on(finished, tmp_path):
    settings, path = finished
    network, best = Reconstructor.load(path).network, f"{settings.output}/checkpoints/best.ckpt"
    assert "trained_on_sha256" not in best_reconstructor(settings, network, best).card
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    settings = replace(settings, data=replace(settings.data, train=["fr079", str(log)]))
    assert best_reconstructor(settings, network, best).card["trained_on_sha256"] == {str(log): file_sha256(log)}


def test_the_checkpoint_has_the_best_weights_not_the_last(finished, tmp_path, monkeypatch):
    let_the_first_epoch_be_the_best(monkeypatch)
    found = Reconstructor.load(train(replace(finished[0], output=str(tmp_path / "worse"))))
    assert (found.card["epoch"], found.card["steps"]) == (0, 4)
    states = [torch.load(tmp_path / "worse" / "checkpoints" / name, weights_only=True)["state_dict"] for name in ("best.ckpt", "last.ckpt")]
    network = found.network.state_dict()
    same = [all(torch.equal(value, state[f"network.{name}"]) for name, value in network.items()) for state in states]
    assert same == [True, False]


def test_another_seed_gives_another_network(finished, tmp_path):
    path = train(replace(finished[0], output=str(tmp_path / "other"), seed=1))
    ours, theirs = (Reconstructor.load(each).network.state_dict() for each in (path, finished[1]))
    assert any(not torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_nan_loss_fails_the_run(finished, tmp_path):
    settings = replace(finished[0], output=str(tmp_path / "nan"), trainer=replace(TRAINER, learning_rate=1e30, warmup_share=0.0))
    with pytest.raises(FloatingPointError, match="training loss is nan at step"):
        train(settings)
    assert not (tmp_path / "nan" / "model.safetensors").exists()


def test_bad_settings_fail_before_anything_is_written(finished, tmp_path):
    with pytest.raises(InputError, match="trainer.epochs"):
        train(replace(finished[0], output=str(tmp_path / "bad"), trainer=replace(TRAINER, epochs=0)))
    assert not (tmp_path / "bad").exists()


def test_a_site_that_teaches_a_map_nothing_is_named_before_the_training(finished, tmp_path):
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    settings = replace(finished[0], output=str(tmp_path / "run"), grid=replace(finished[0].grid, minimum_points=500))
    with pytest.raises(InputError, match=f"^data.calibrate: {log}: expected more than 500 voxels with returns within"):
        train(replace(settings, data=replace(settings.data, calibrate=[str(log)])))
    assert not (tmp_path / "run").exists()


def test_mappers_are_scored_on_the_test_sites_and_writers_get_the_result(finished, tmp_path, monkeypatch):
    """The trained network is put where a mapper asks for it, and nowhere else."""
    settings, path = finished
    settings = replace(settings, data=replace(settings.data, test=["simulated:900002"]))
    written = []
    mappers = {"cvae-hm": HilbertMap("trained"), "raw-grid-hm": HilbertMap(grid=settings.grid), "nearest": NearestMapper()}
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
    assert train(settings, mappers, lambda *arguments: written.append(arguments)) == path
    ((result, site, fitted),) = written
    assert (site.name, result.site) == ("simulated:900002", "simulated:900002")
    assert result.failed == {} and set(result.scores) == set(mappers)
    assert fitted["raw-grid-hm"].reconstructor is None
    assert fitted["cvae-hm"].reconstructor.map_weights == Reconstructor.load(path).map_weights
    json.dumps(result.plain(), allow_nan=False)


def test_the_maps_weights_are_learned_over_the_runs_flips(finished, tmp_path):
    settings, path = finished
    other = train(replace(settings, output=str(tmp_path / "one"), flips=1))
    one, four = Reconstructor.load(other), Reconstructor.load(path)
    assert all(torch.equal(a, b) for a, b in zip(one.network.state_dict().values(), four.network.state_dict().values(), strict=True))
    assert one.map_weights != four.map_weights


@pytest.mark.parametrize(("on_cpu", "on_gpu"), [(False, True), (True, False)])
def test_numbers_are_those_that_the_processor_multiplies_in(tmp_path, monkeypatch, on_cpu, on_gpu):
    has = {"cpu": on_cpu, "cuda": on_gpu}
    monkeypatch.setattr("hilbertvae.reconstruction.precision.fast_type", lambda kind: torch.bfloat16 if has[kind] else torch.float32)
    words = {True: "bf16-mixed", False: "32-true"}
    for gpu in (False, True):
        monkeypatch.setattr(torch.cuda, "is_available", lambda gpu=gpu: gpu)
        for accelerator, found in (("cpu", on_cpu), ("gpu", on_gpu), ("auto", on_gpu if gpu else on_cpu)):
            chosen = replace(TRAINER, precision="auto", accelerator=accelerator)
            assert _precision(tiny_settings(tmp_path, tmp_path, trainer=chosen)) == words[found]
    assert _precision(tiny_settings(tmp_path, tmp_path, trainer=replace(TRAINER, precision="16-mixed"))) == "16-mixed"


def test_no_network_learns_from_wrong_gradients(tmp_path, monkeypatch):
    """On CPUs torch gets those of 3D convolutions on 2 x 2 x 2 cells wrong in bfloat16."""
    monkeypatch.setattr("hilbertvae.reconstruction.precision.fast_type", lambda kind: torch.bfloat16)
    settings = tiny_settings(tmp_path, tmp_path, trainer=replace(TRAINER, precision="auto", accelerator="cpu"))
    for dimension, cells, levels, expected in ((3, 32, 3, "32-true"), (3, 32, 2, "bf16-mixed"), (2, 32, 3, "bf16-mixed")):
        network = GatedNetworkSettings(channels=[8] * levels, blocks=[1] * levels)
        other = replace(settings, dimension=dimension, grid=replace(settings.grid, cells=cells), network=network)
        assert _precision(other) == expected
