"""Runs that differ in scoring alone share one training."""

import errno
import json
import threading
from dataclasses import replace

import joblib
import pytest
import torch
from training_toys import tiny_settings

pytest.importorskip("embreex")
pytest.importorskip("shapely")

from hilbertvae.checks import InputError  # noqa: E402
from hilbertvae.mappers.hilbert_map import HilbertMap  # noqa: E402
from hilbertvae.reconstruction.networks import NETWORKS  # noqa: E402
from hilbertvae.reconstruction.reconstructor import Reconstructor  # noqa: E402
from hilbertvae.reports.report import Report  # noqa: E402
from hilbertvae.scoring.protocol import Protocol  # noqa: E402
from hilbertvae.training import kept_network as kept_module  # noqa: E402
from hilbertvae.training.kept_network import KeptNetwork, kept_name  # noqa: E402
from hilbertvae.training.reconstruction_module import ReconstructionModule  # noqa: E402
from hilbertvae.training.scoring import score  # noqa: E402
from hilbertvae.training.train import train  # noqa: E402
from hilbertvae.training.training_hash import training_hash  # noqa: E402


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A run whose network is kept."""
    folder = tmp_path_factory.mktemp("kept")
    settings = tiny_settings(folder / "first", folder / "cache", trained=str(folder / "trained"))
    with joblib.parallel_config(backend="threading"):
        return settings, train(settings)


def test_a_run_that_differs_in_scoring_alone_does_not_train(first, tmp_path, monkeypatch):
    settings, path = first
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
    other = replace(settings, output=str(tmp_path / "other"), case="other", evaluation=Protocol(gap_seeds=[3], gap_ratio=0.25))
    again = train(other)
    assert again.read_bytes() == path.read_bytes() and str(again) == f"{other.output}/model.safetensors"


def test_another_training_is_another_network(first, tmp_path):
    settings, path = first
    seeded = replace(settings, output=str(tmp_path / "seeded"), seed=1)
    assert kept_name(seeded) != kept_name(settings)
    assert kept_name(replace(settings, validation_gap_m=1.0)) != kept_name(settings)
    states = [Reconstructor.load(file).network.state_dict() for file in (train(seeded), path)]
    assert any(not torch.equal(*pair) for pair in zip(*(state.values() for state in states), strict=True))


def test_a_kept_network_takes_the_place_of_one_that_was_trained_there(first, tmp_path):
    """Else its folder would go on from the other's last epoch once nothing is kept any more."""
    settings, path = first
    output = tmp_path / "job"
    train(replace(settings, output=str(output), seed=2))
    assert (output / "checkpoints/last.ckpt").exists() and list((output / "tensorboard").iterdir())
    assert train(replace(settings, output=str(output))).read_bytes() == path.read_bytes()
    assert not (output / "checkpoints").exists() and not (output / "tensorboard").exists()
    assert (output / "training.json").read_bytes() == (path.parent / "training.json").read_bytes()


def test_a_training_that_was_not_kept_is_not_begun_anew_as_one_that_is(first, tmp_path):
    """Its epochs may be hours of work, and lie nowhere else; kept as they are, they might be of other code than their name says."""
    settings, _ = first
    own = replace(settings, output=str(tmp_path / "own"), trained=None)
    before = train(own).read_bytes()
    with pytest.raises(InputError, match="^trained: .*own holds a training that was begun without it"):
        train(replace(own, trained=settings.trained))
    with pytest.raises(InputError, match="^output: .*own holds a run with other settings"):
        train(replace(own, seed=2, trained=settings.trained))
    assert (tmp_path / "own/model.safetensors").read_bytes() == before and (tmp_path / "own/checkpoints/last.ckpt").exists()


def test_what_is_done_afterwards_or_elsewhere_does_not_name_a_network(first):
    settings, _ = first
    for changes in ({"name": "x"}, {"case": "x"}, {"size": "full"}, {"pictures": True}, {"trained": None}, {"scoring_processes": 2}):
        assert training_hash(replace(settings, **changes)) == training_hash(settings), changes


def test_a_network_says_how_long_it_took_wherever_it_is_used(first, tmp_path):
    settings, _ = first
    found = KeptNetwork(settings.trained, kept_name(settings)).take(tmp_path / "copy")
    assert set(found.seconds) == {"grids", "train", "weights"} and all(seconds >= 0 for seconds in found.seconds.values())


def test_a_network_that_was_copied_without_its_seconds_is_taken(first, tmp_path):
    _, path = first
    place = KeptNetwork(tmp_path / "trained", "a")
    place.path.write_bytes(path.read_bytes())
    found = place.take(tmp_path / "model.safetensors")
    assert found.seconds == {} and (tmp_path / "model.safetensors").read_bytes() == path.read_bytes()


def test_whoever_comes_second_waits_and_is_given_the_network(tmp_path, first):
    _, path = first
    one, two = KeptNetwork(tmp_path, "same"), KeptNetwork(tmp_path, "same")
    assert one.take(tmp_path / "one") is None
    found = []
    waiting = threading.Thread(target=lambda: found.append(two.take(tmp_path / "two")))
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive() and not found
    one.keep(path, {"train": 1.5})
    waiting.join(20)
    assert isinstance(found[0], Reconstructor) and found[0].seconds == {"train": 1.5} and two.trained_in == str(path.parent)
    assert (tmp_path / "two").read_bytes() == path.read_bytes()


def test_where_files_can_t_be_locked_a_network_is_kept_all_the_same(tmp_path, first, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    pytest.importorskip("fcntl")
    monkeypatch.setattr("fcntl.flock", no_locks)
    place = KeptNetwork(tmp_path / "trained", "same")
    assert place.take(tmp_path / "copy") is None
    place.keep(first[1], {"train": 1.5})
    assert KeptNetwork(tmp_path / "trained", "same").take(tmp_path / "copy").seconds == {"train": 1.5}


def test_a_training_that_breaks_leaves_the_place_free(tmp_path, first, monkeypatch):
    settings = replace(first[0], output=str(tmp_path / "broken"), trained=str(tmp_path / "trained"))
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        train(settings)
    assert not list((tmp_path / "trained").glob("*.safetensors"))
    assert KeptNetwork(settings.trained, kept_name(settings)).take(tmp_path / "copy") is None


@pytest.mark.parametrize("module", ["training.reconstruction_module", "reconstruction.reconstructor", "mappers.weights", "grids.frame",
                                    "scoring.calibration", "scoring.cases", "sums"])  # fmt: skip
def test_the_code_that_trains_and_weighs_names_a_kept_network(first, monkeypatch, module):
    """The map's weights are kept with the network, so what learns them counts, too."""
    parts = []
    monkeypatch.setattr(kept_module, "code_hash", lambda names: parts.extend(names) or "")
    kept_name(first[0])
    path = module.replace(".", "/") + ".py"
    assert path in parts or path.split("/")[0] in parts


def test_a_damaged_network_is_named(tmp_path):
    (tmp_path / "same.safetensors").write_bytes(b"nothing of the kind")
    (tmp_path / "same.json").write_text("{}")
    with pytest.raises(InputError, match="same.safetensors"):
        KeptNetwork(tmp_path, "same").take(tmp_path / "copy")


class TestWeightsLearnedAnew:
    """The rank weights belong to K and to where the grids lie."""

    @staticmethod
    def scored(settings, path, **parameters) -> HilbertMap:
        mappers = {"cvae-hm": HilbertMap("trained", **parameters)}
        tested = replace(settings, data=replace(settings.data, test=["simulated:900002"]))
        written = []
        score(tested, mappers, Reconstructor.load(path), lambda *arguments: written.append(arguments))
        ((result, _, given),) = written
        assert not result.failed
        return given["cvae-hm"]

    @pytest.mark.parametrize("neighbours", [1, 3])
    def test_another_number_of_grids_has_as_many_weights(self, first, neighbours):
        mapper = self.scored(*first, neighbours=neighbours)
        assert {len(weights["unseen"]) for weights in mapper.reconstructor.map_weights.values()} == {neighbours + 1}

    def test_results_name_the_seeds_that_they_were_learned_with(self, first, tmp_path):
        """The network's own are those of its card, also in a run with others."""
        settings, path = first
        tested = replace(settings, data=replace(settings.data, test=["simulated:900002"]), calibration_seeds=[107])
        network = Reconstructor.load(path)
        seeds = {"calibration": network.card["learned_as"]["calibration_seeds"]}
        mappers = {"own": HilbertMap("trained"), "anew": HilbertMap("trained", neighbours=1)}
        score(tested, mappers, network, Report(tmp_path, {"name": "run"}, seeds=seeds, pictures=False))
        assert json.loads((tmp_path / "result.json").read_text())["seeds"] == seeds | {"calibration_anew": {"anew": [107]}}
        assert seeds["calibration"] != [107]

    def test_an_occupied_point_counts_for_as_much_as_in_the_network_s_own(self, first, tmp_path):
        settings, path = first
        network = Reconstructor.load(path)
        network.map_weights["points"]["occupied_weight"] = 1.2
        mapper = self.scored(settings, network.save(tmp_path / "shy.safetensors"), neighbours=3)
        assert mapper.reconstructor.map_weights["points"]["occupied_weight"] == 1.2 != settings.calibration_occupied_weight

    def test_a_site_that_the_network_knows_teaches_no_weights(self, first, tmp_path):
        settings, path = first
        network = Reconstructor.load(path)
        network.card["trained_on"] = [settings.data.validate]
        with pytest.raises(InputError, match=f"data.validate: {settings.data.validate} is among what the network whose weights"):
            self.scored(settings, network.save(tmp_path / "leak.safetensors"), neighbours=1)

    def test_another_site_than_the_network_s_own_is_said(self, first):
        settings, path = first
        other = replace(settings, data=replace(settings.data, validate="simulated:900003"))
        with pytest.warns(UserWarning, match="data.validate: weights are learned anew on simulated:900003, the network's own were"):
            self.scored(other, path, neighbours=1)
        other = replace(settings, data=replace(settings.data, calibrate=["simulated:900003", "simulated:900004"]))
        with pytest.warns(
            UserWarning, match="data.calibrate: weights are learned anew on simulated:900003, simulated:900004, the network's"
        ):
            self.scored(other, path, neighbours=1)

    def test_the_same_site_made_otherwise_is_said(self, first):
        settings, path = first
        other = replace(settings, data=replace(settings.data, simulated_scans=15))
        with pytest.warns(UserWarning, match="own were learned on simulated:900001, made otherwise; results"):
            self.scored(other, path, neighbours=1)

    def test_evidence_in_other_voxels_is_weighed_on_its_own(self, first):
        usual, coarse = self.scored(*first), self.scored(*first, resolution_m=0.2)
        assert usual.evidence_.resolution_m == 0.1 and coarse.evidence_.resolution_m == 0.2
        assert coarse.reconstructor.map_weights != usual.reconstructor.map_weights == Reconstructor.load(first[1]).map_weights
        assert self.scored(*first, resolution_m=0.1).reconstructor.map_weights == usual.reconstructor.map_weights

    def test_grids_farther_apart_are_fewer_and_weighed_on_their_own(self, first):
        farther = first[0].grid.cluster_diameter_m / 2
        usual, sparse = self.scored(*first), self.scored(*first, inner_radius_m=farther)
        assert sparse.grid_.inner_radius_m == farther and sparse.cluster_count() < usual.cluster_count()
        assert sparse.reconstructor.map_weights != usual.reconstructor.map_weights == Reconstructor.load(first[1]).map_weights


def test_code_of_ones_own_names_a_network_too(first, monkeypatch):
    settings, _ = first
    usual = kept_name(settings)
    monkeypatch.setattr(kept_module, "foreign_source", lambda kind: "class Mine: pass")
    assert kept_name(settings) != usual
    monkeypatch.setattr(kept_module, "foreign_source", lambda kind: None)
    with pytest.raises(InputError, match="^trained: expected none with a network whose code is in no file"):
        kept_name(settings)
    ours = {type(settings.network), NETWORKS[settings.network.kind][1]}
    monkeypatch.setattr(kept_module, "foreign_source", lambda kind: "" if kind in ours else "class Mine: pass")
    assert kept_name(settings) != usual  # by the likelihood alone
    monkeypatch.setattr(kept_module, "foreign_source", lambda kind: "" if kind in ours else None)
    with pytest.raises(InputError, match="^trained: expected none with a likelihood whose code is in no file"):
        kept_name(settings)


def test_a_kind_that_is_unknown_is_named_before_a_place_is_looked_for(first):
    settings = replace(first[0], network=replace(first[0].network, kind="foo"))
    with pytest.raises(InputError, match="^network.kind: expected 'gated', as the chosen network has, got 'foo'"):
        train(settings)
