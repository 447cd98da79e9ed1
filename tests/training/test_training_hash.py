from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from training_toys import TRAINER, tiny_settings

from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.training.settings import Settings
from hilbertvae.training.training_hash import recipe_hash, training_hash
from toy_rooms import carmen_line, write_log

pytest.importorskip("embreex")
pytest.importorskip("shapely")


def test_the_training_hash_sees_what_changes_a_network_and_not_where_it_lies():
    settings = tiny_settings("run", "cache")
    elsewhere = tiny_settings("elsewhere", "other", name="x", pictures=True, mapper={"hm": {}})
    elsewhere = replace(elsewhere, data=replace(elsewhere.data, test=["intel"], folder="logs"))
    assert training_hash(elsewhere) == training_hash(settings)
    for change in ({"seed": 1}, {"trainer": replace(TRAINER, epochs=3)}, {"grid": replace(settings.grid, cells=32)}, {"resolution_m": 0.2}):
        assert training_hash(replace(settings, **change)) != training_hash(settings)


def test_the_hash_of_a_recipe_sees_all_of_that_but_the_seed_and_threads(finished):
    settings = tiny_settings("run", "cache")
    first = recipe_hash(settings, None)
    assert recipe_hash(replace(settings, seed=1, trainer=replace(TRAINER, threads=7)), None) == first
    assert recipe_hash(replace(settings, trainer=replace(TRAINER, learning_rate=1e-5)), None) != first
    start = replace(settings, trainer=replace(TRAINER, initial=str(finished[1])))
    ones = [recipe_hash(start, card) for card in ({"recipe_hash": "a"}, {"recipe_hash": "b"}, {})]
    assert len({first, *ones}) == 4  # of networks that start from one of another recipe
    assert Reconstructor.load(finished[1]).card["recipe_hash"] == recipe_hash(finished[0], None)


def test_the_hash_of_a_training_sees_what_a_path_holds(tmp_path):
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    settings = replace(settings, data=replace(settings.data, train=[str(log)]))
    first = training_hash(settings)
    assert training_hash(settings) == first
    write_log(log, [carmen_line(np.full(180, 3.0), [0, 0, 0])])
    assert training_hash(settings) != first


def test_the_hash_of_a_training_does_not_see_where_its_scans_lie(tmp_path):
    """A run that was copied to another machine with its scans goes on there."""

    def settings_in(folder: Path) -> Settings:
        sites = {name: str(write_log(folder / f"{name}.log", [carmen_line(np.full(180, 2.0), [x, 0, 0])])) for x, name in enumerate("abc")}
        settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
        return replace(settings, data=replace(settings.data, train=[sites["a"]], validate=sites["b"], calibrate=[sites["c"]]))

    (tmp_path / "copied").mkdir()
    here, there = map(settings_in, (tmp_path, tmp_path / "copied"))
    assert training_hash(here) == training_hash(there) and recipe_hash(here, None) == recipe_hash(there, None)
    swapped = replace(here, data=replace(here.data, train=[here.data.validate], validate=here.data.train[0]))
    assert training_hash(swapped) != training_hash(here)
