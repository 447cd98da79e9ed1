"""Runs of one row of a table differ in their training seed alone."""

import pytest

from hilbertvae.checks import InputError
from hilbertvae.tables.sweep import grouped, read_sweep
from toy_sweeps import put


def rows(folder, first, second):
    put(folder, "a-seed0", {"nearest": [0.1, 0.2]}, config=first)
    put(folder, "a-seed1", {"nearest": [0.1, 0.2]}, config=second)
    return grouped(read_sweep(folder, "table1").runs, lambda run: run.case)


@pytest.mark.parametrize(
    ("config", "key"),
    [
        ({"network": {"channels": [16, 16]}}, "network.channels"),
        ({"trainer": {"epochs": 2, "threads": 1}}, "trainer.epochs"),
        ({"data": {"simulated": 60}}, "data.simulated"),
        ({"calibration_occupied_weight": 1.0}, "calibration_occupied_weight"),
        ({"mapper": {"cvae-hm": {"neighbours": 3}, "hm": {}}}, "mapper.cvae-hm"),
    ],
)
def test_another_recipe_is_another_row(tmp_path, config, key):
    usual = {"trainer": {"epochs": 1, "threads": 1}, "data": {"simulated": 30}, "calibration_occupied_weight": 2.0}
    usual["mapper"] = {"cvae-hm": {}}
    with pytest.raises(InputError) as error:
        rows(tmp_path, usual, usual | config)
    text = str(error.value)
    assert text.startswith(f"{tmp_path / 'a-seed1' / 'result.json'}: config.{key}: ") and str(tmp_path / "a-seed0") in text


def test_where_it_ran_and_settings_of_another_version_make_no_other_row(tmp_path):
    here = {"trainer": {"epochs": 1, "threads": 1, "accelerator": "cpu"}, "data": {"simulated": 30, "cache": "here", "test": ["hall"]}}
    here["mapper"] = {"cvae-hm": {"flips": 4, "device": "cuda"}}
    there = {"trainer": {"epochs": 1, "threads": 2, "accelerator": "gpu"}, "data": {"simulated": 30, "cache": "there"}, "flips": None}
    there["mapper"] = {"cvae-hm": {"flips": 4, "device": "auto"}}
    assert [*rows(tmp_path, here, there)["a"]] == [0, 1]


@pytest.mark.parametrize(
    ("said", "key", "other"),
    [
        ({"recipe_hash": "b"}, "recipe_hash", "'b'"),
        ({"calibrated_on": ["lab"]}, "calibrated_on", r"\['lab'\]"),
        ({"learned_as": {"calibration_seeds": [101]}}, "learned_as.calibration_seeds", r"\[101\]"),
        ({"learned_as": {"calibration_seeds": [100], "calibration_given": "map"}}, "learned_as.calibration_given", "'map'"),
    ],
)
def test_networks_that_were_trained_by_other_recipes_are_no_row(tmp_path, said, key, other):
    """Where a run is given its network, how that was trained is no setting of the run."""
    for seed, more in ((0, {}), (1, said)):
        card = {"recipe_hash": "a", "calibrated_on": ["hall"], "learned_as": {"calibration_seeds": [100]}, "epoch": seed} | more
        about = {"seeds": {"training": seed}, "card": card}
        put(tmp_path, f"a-seed{seed}", {"nearest": [0.1, 0.2]}, config={"checkpoint": "a.safetensors"}, about=about)
    with pytest.raises(InputError, match=rf"a-seed1/result.json: card.{key}: {other}, but "):
        grouped(read_sweep(tmp_path, "table1").runs, lambda run: "a")


CARDS = (
    {"recipe_hash": "a", "epoch": 3, "learned_as": {"calibration_seeds": [100], "calibration_given": "scans"}},
    {"recipe_hash": "a", "epoch": 4, "learned_as": {"calibration_seeds": [100]}},  # from before maps could be given
    {"epoch": 5},
)


def test_cards_of_one_recipe_and_those_that_say_nothing_of_it_are_a_row(tmp_path):
    for seed, card in enumerate(CARDS):
        about = {"seeds": {"training": seed}, "card": card}
        put(tmp_path, f"a-seed{seed}", {"nearest": [0.1, 0.2]}, config={"checkpoint": "a.safetensors"}, about=about)
    assert [*grouped(read_sweep(tmp_path, "table1").runs, lambda run: "a")["a"]] == [0, 1, 2]
