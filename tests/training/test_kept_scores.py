"""A scoring that was stopped goes on, and ends with what one that was not would have found."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from training_toys import tiny_settings

from hilbertvae.files import hash_of
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.mappers.constant import ConstantMapper
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.likelihood import Bernoulli
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import GatedNetworkSettings, LikelihoodSettings
from hilbertvae.reports.run_folder import UNFINISHED
from hilbertvae.scoring.protocol import Protocol, evaluate_all
from hilbertvae.training import kept_scores
from hilbertvae.training.kept_scores import KeptScores, described
from hilbertvae.training.opened_sites import opened_site
from hilbertvae.training.scoring import score
from hilbertvae.training.settings import DataSettings


class Stopped(NearestMapper):
    """Is stopped in the fit of one seed, as by Ctrl-C, unless told not to; counts all fits."""

    stop_at: int | None = None
    fits = 0

    def __init__(self, neighbours=1, seed=0):
        super().__init__(neighbours)
        self.seed = seed

    def _fit(self, points, occupied, weight):
        if self.seed == Stopped.stop_at:
            raise KeyboardInterrupt
        Stopped.fits += 1
        super()._fit(points, occupied, weight)


class SeededText(ConstantMapper):
    def __init__(self, text=""):
        self.text = text


@pytest.fixture
def settings(tmp_path):
    data = DataSettings(test=["simulated:900002"], simulated_extent_m=[12, 16], simulated_scans=20)
    found = tiny_settings(tmp_path / "run", tmp_path / "cache", data)
    found.evaluation = Protocol(gap_seeds=[0, 1, 2], occlusion=False)
    return found


def mappers(**changes) -> dict[str, Mapper]:
    return {"early": ConstantMapper(), "late": Stopped(**changes)}


def stopped_at(settings, seed: int, **changes) -> list:
    """What is written by a scoring that is stopped there, and its fits."""
    written: list = []
    Stopped.stop_at, Stopped.fits = seed, 0
    try:
        score(settings, mappers(**changes), None, lambda result, *_: written.append(result))
    except KeyboardInterrupt:
        assert not written
    finally:
        Stopped.stop_at = None
    return written


def files(settings) -> list:
    return sorted((Path(settings.output) / UNFINISHED).glob("*"))


def test_it_goes_on_after_the_last_seed_and_finds_the_same(settings, capsys):
    site = opened_site(settings.data.test[0], settings)
    whole = evaluate_all(mappers(), site, settings.evaluation)
    assert stopped_at(settings, 2) == [] and Stopped.fits == 2
    assert len(files(settings)) == 5  # three of the first mapper, two of the second
    (result,) = stopped_at(settings, -1)
    assert Stopped.fits == 1
    assert "late on" in capsys.readouterr().out.replace("early on", "")
    for name in ("site", "gap_seeds", "gaps", "scores", "curves", "ceiling", "protocol", "maps", "failed"):
        assert getattr(result, name) == getattr(whole, name), name
    assert set(result.seconds) == set(whole.seconds) and len(result.seconds["late"]["fit"]) == 3
    assert not files(settings)


@pytest.mark.parametrize("changed", ["mapper", "protocol", "resolution", "site"])
def test_what_has_changed_is_scored_anew(settings, changed):
    stopped_at(settings, 2)
    changes = {}
    if changed == "mapper":
        changes["neighbours"] = 3
    elif changed == "protocol":
        settings.evaluation.gap_ratio = 0.4
    elif changed == "resolution":
        settings.resolution_m = 0.2
    else:
        settings.data.test = ["simulated:900003"]
    (result,) = stopped_at(settings, -1, **changes)
    assert Stopped.fits == 3 and len(result.scores["late"]["points"]["gaps"]["auc"]) == 3


def test_a_mapper_is_known_by_all_code_and_files_that_it_names(tmp_path, monkeypatch):
    """Also by what its class is derived from, by folders, and by paths in lists."""
    base, data, folder = tmp_path / "somebase.py", tmp_path / "table.txt", tmp_path / "tables"
    folder.mkdir()

    def write(**said):
        base.write_text(
            f"from hilbertvae.mappers.constant import ConstantMapper\nclass Base(ConstantMapper):\n    cut = {said.get('code')}\n"
        )
        (tmp_path / "somebodys.py").write_text(
            "from somebase import Base\nclass Own(Base):\n    def __init__(self, a=None, b=None):\n        self.a, self.b = a, b\n"
        )
        data.write_text(f"{said.get('table')}")
        (folder / "one.txt").write_text(f"{said.get('inner')}")

    def found(a, b):
        for name in ("somebodys", "somebase"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        importlib.invalidate_caches()
        return hash_of(described(importlib.import_module("somebodys").Own(a, b)))

    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for change, a, b in (
        ("code", 1, 2),
        ("table", [str(data)], ""),
        ("table", {"x": data}, "."),
        ("inner", str(folder), 1),
        ("inner", folder, 1),
    ):
        write()
        before = found(a, b)
        assert found(a, b) == before
        write(**{change: "1e6"})
        assert found(a, b) != before, (change, a)


def test_a_setting_may_be_any_text():
    """Also one that no file can be called."""
    for text in ("x" * 5000, "a/" * 3000, "nothing\0here", ""):
        assert described(SeededText(text))[-1] == {"text": text}


def test_more_seeds_take_those_that_are_there(settings):
    stopped_at(settings, 2)
    settings.evaluation.gap_seeds = [0, 1, 3]
    (result,) = stopped_at(settings, -1)
    assert Stopped.fits == 1 and result.gap_seeds == [0, 1, 3]


def test_a_damaged_file_is_scored_anew(settings):
    stopped_at(settings, 2)
    for file in files(settings):
        file.write_text(file.read_text()[:100])
    (result,) = stopped_at(settings, -1)
    assert Stopped.fits == 3 and not result.failed


def test_processes_keep_and_take_the_same(settings):
    settings.scoring_processes = 2
    with pytest.raises(KeyboardInterrupt):  # as if stopped while pictures are drawn
        score(settings, mappers(), None, _stop)
    assert len(files(settings)) == 6
    kept = KeptScores(settings, settings.data.test[0])
    kept.path({"late": Stopped()}, 2).unlink()
    for file in files(settings):  # marked, so that it can be told whose they are
        content = json.loads(file.read_text())
        content["scores"] = {name: _all_set(tree, 0.125) for name, tree in content["scores"].items()}
        file.write_text(json.dumps(content))
    (result,) = stopped_at(settings, -1)
    found = np.array(result.scores["late"]["points"]["gaps"]["auc"])
    assert (found[:2] == 0.125).all() and found[2] != 0.125
    assert result.scores["early"]["voxels"]["gaps"]["auc"] == [0.125] * 3


def _stop(*_):
    raise KeyboardInterrupt


def _all_set(tree, value):
    return {key: _all_set(below, value) for key, below in tree.items()} if isinstance(tree, dict) else [value] * len(tree)


def test_a_mapper_that_failed_leaves_the_others_to_take(settings):
    class Broken(ConstantMapper):
        def _fit(self, points, occupied, weight):
            raise MemoryError("too many")

    written: list = []
    score(settings, {"broken": Broken(), "late": Stopped()}, None, lambda result, *_: written.append(result))
    assert written[0].failed and len(files(settings)) == 3
    Stopped.fits = 0
    score(settings, {"late": Stopped()}, None, None)
    assert Stopped.fits == 0 and not files(settings)


@pytest.mark.parametrize("wrong", [{"scores": {}}, {"gap_seeds": [1]}])
def test_a_file_that_says_something_else_is_scored_anew(settings, wrong):
    whole = evaluate_all(mappers(), opened_site(settings.data.test[0], settings), settings.evaluation)
    stopped_at(settings, 2)
    for file in files(settings):
        file.write_text(json.dumps(json.loads(file.read_text()) | wrong))
    (result,) = stopped_at(settings, -1)
    assert result.scores == whole.scores


def test_code_that_was_edited_while_a_run_went_on(settings, monkeypatch):
    """What a run keeps is marked by the code that it loaded, not by what lies on the disk by then."""
    before = KeptScores(settings, settings.data.test[0]).path(mappers(), 0)
    monkeypatch.setattr(kept_scores, "code_hash", lambda parts: "edited")
    assert KeptScores(settings, settings.data.test[0]).path(mappers(), 0) == before
    monkeypatch.setattr(kept_scores, "CODE", "edited")
    assert KeptScores(settings, settings.data.test[0]).path(mappers(), 0) != before


def test_another_gpu_scores_anew(settings, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    kept, found = KeptScores(settings, settings.data.test[0]), {}
    for gpu in ("a GPU", "another"):
        monkeypatch.setattr(torch.cuda, "get_device_name", lambda device, gpu=gpu: gpu)
        found[gpu] = [kept.path({"ours": HilbertMap(device=device)}, 0) for device in ("cpu", "cuda")]
    assert found["a GPU"][0] == found["another"][0] and found["a GPU"][1] != found["another"][1]


def test_arrays_among_a_mapper_s_settings_count_whole(settings):
    kept, prior = KeptScores(settings, settings.data.test[0]), np.zeros(5000)
    zeros = kept.path({"mine": Stopped(neighbours=prior)}, 0)
    assert kept.path({"mine": Stopped(neighbours=prior.copy())}, 0) == zeros
    prior[2500] = 1
    assert kept.path({"mine": Stopped(neighbours=prior)}, 0) != zeros


def test_two_sites_of_the_same_scans(settings, tmp_path):
    site = opened_site(settings.data.test[0], settings)
    for name in ("monday.npz", "tuesday.npz"):
        scans = site.scans
        np.savez(tmp_path / name, points=scans.points, origins=scans.origins, scan=scans.scan)
    settings.data.test = [str(tmp_path / "monday.npz"), str(tmp_path / "tuesday.npz")]
    written: list = []
    score(settings, mappers(), None, lambda result, *_: written.append(result))
    assert [result.site for result in written] == ["monday.npz", "tuesday.npz"] and not any(result.failed for result in written)
    assert written[0].scores == written[1].scores


def test_scores_that_can_not_be_kept_are_scores_all_the_same(settings):
    Path(settings.output).mkdir(parents=True)
    (Path(settings.output) / UNFINISHED).write_text("in the way")
    written: list = []
    with pytest.warns(UserWarning, match="scores can't be kept, so that a run which is stopped starts anew"):
        score(settings, mappers(), None, lambda result, *_: written.append(result))
    assert not written[0].failed and len(written[0].scores["late"]["points"]["gaps"]["auc"]) == 3


@pytest.mark.parametrize("answer", [None, True, False])
def test_scores_are_kept_where_a_writer_could_not_write_all(settings, answer):
    """Pictures that can't be drawn don't ask for hours of scoring again."""
    score(settings, mappers(), None, lambda *_: answer)
    assert (Path(settings.output) / UNFINISHED).exists() == (answer is False)


def test_scores_of_code_that_no_file_holds_are_not_kept(settings, room):
    """Typed in, as in a notebook, it may be another the next time."""
    typed = type("Typed", (NearestMapper,), {"__module__": "__main__"})()
    kept, found = KeptScores(settings, "simulated:900002"), evaluate_all({"early": ConstantMapper()}, room, Protocol([0], occlusion=False))
    for mapper, there in ((typed, False), (NearestMapper(), True)):
        kept.keep({"early": mapper}, 0, found)
        assert (kept.take({"early": mapper}, 0) is not None) == there


@pytest.mark.parametrize("part", ["network", "likelihood"])
def test_a_network_s_own_code_counts_as_a_mapper_s_does(settings, monkeypatch, part):
    """Its weights would be the same after its `forward` was mended."""
    few = GatedNetworkSettings(channels=[4], blocks=[1], latent=2)
    grid = GridSettings(cells=8)
    ours = HilbertMap(Reconstructor(build_network(few, 2, 8), few, LikelihoodSettings(), grid, 2, 0.1))
    kept = KeptScores(settings, settings.data.test[0])
    theirs = {"network": GatedNetwork, "likelihood": Bernoulli}[part]
    found = []
    for source in ("", "before", "after", None):
        monkeypatch.setattr(kept_scores, "foreign_source", lambda kind, source=source: source if kind is theirs else "")
        found.append(kept.path({"ours": ours}, 0))
    assert len({*found}) == 4 and found[-1] is None
