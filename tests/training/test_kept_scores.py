"""A scoring that was stopped goes on, and ends with what one that was not would have found."""

import json
from pathlib import Path

import numpy as np
import pytest
from training_toys import tiny_settings

from hilbertvae.mappers.constant import ConstantMapper
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scoring.protocol import Protocol, evaluate_all
from hilbertvae.training.kept_scores import FOLDER, KeptScores
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
    return sorted((Path(settings.output) / FOLDER).glob("*"))


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
    stopped_at(settings, 2)
    settings.scoring_processes = 2
    names = {file.name for file in files(settings)}
    kept = KeptScores(settings, settings.data.test[0])
    for file in files(settings):  # marked, so that it can be told whose they are
        content = json.loads(file.read_text())
        content["scores"] = {name: _all_set(tree, 0.125) for name, tree in content["scores"].items()}
        file.write_text(json.dumps(content))
    assert {kept.path({"late": Stopped()}, seed).name for seed in (0, 1)} < names
    (result,) = stopped_at(settings, -1)
    found = np.array(result.scores["late"]["points"]["gaps"]["auc"])
    assert (found[:2] == 0.125).all() and found[2] != 0.125
    assert result.scores["early"]["voxels"]["gaps"]["auc"] == [0.125] * 3


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
