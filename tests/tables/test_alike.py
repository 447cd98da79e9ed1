"""Runs that can't stand in one table, and what is noted of those that can."""

import pytest

from hilbertvae.checks import InputError
from hilbertvae.tables.alike import Alike, check_alike, origin_notes
from hilbertvae.tables.layouts import read_page
from hilbertvae.tables.sweep import read_sweep
from toy_sweeps import change, put, put_failed


def two(folder, how):
    put(folder, "a-seed0", {"nearest": [0.1, 0.2]})
    change(put(folder, "b-seed0", {"nearest": [0.1, 0.2]}), how)
    return read_sweep(folder, "table1")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (lambda c: c["packages"].update(hilbertvae="0.2.0"), "packages.hilbertvae: '0.2.0', but '0.1.0' in "),
        (lambda c: c["protocol"].update(gap_ratio=0.25), "protocol.gap_ratio: 0.25, but 0.5 in "),
        (lambda c: c["protocol"].update(bends=True), "protocol: ['bends', "),
        (lambda c: c.update(gap_seeds=[4, 5]), "gap_seeds: [4, 5], but [0, 1] in "),
        (lambda c: c.update(gap_diameter_m=1.0), "gap_diameter_m: 1.0, but 2.5 in "),
        (lambda c: c.update(site="stairs"), "site: 'stairs', but 'hall' in "),
        (lambda c: c.update(dimension=3), "dimension: 3, but 2 in "),
        (lambda c: c["data"].update(hall="ffff"), "data.hall: 'ffff', but '00ff' in "),
        (lambda c: c["config"].update(resolution_m=0.2), "resolution_m: 0.2, but 0.1 in "),
    ],
)
def test_refused(tmp_path, how, message):
    sweep = two(tmp_path, how)
    with pytest.raises(InputError) as error:
        check_alike(sweep, Alike())
    text = str(error.value)
    assert text.startswith(f"{tmp_path / 'b-seed0' / 'result.json'}: {message}") and "\n" not in text and str(tmp_path / "a-seed0") in text


def test_two_sites_of_one_name_are_told_apart_by_what_was_cut(tmp_path):
    """A simulated site is a seed, and its result does not say by what settings it was made."""
    cut = [[{"seed": seed, "centres": [[1.0, at]], "radius_m": [1.25], "share": 0.1} for seed in (0, 1)] for at in (2.0, 2.0 + 1e-9, 5.0)]
    for name, gaps in zip("abc", cut, strict=True):
        change(put(tmp_path, f"{name}-seed0", {"nearest": [0.1, 0.2]}), lambda content, gaps=gaps: content.update(gaps=gaps))
    sweep = read_sweep(tmp_path, "table1")
    with pytest.raises(InputError, match="c-seed0.*: gaps: .*, but .* in .*a-seed0"):
        check_alike(sweep, Alike())
    check_alike(sweep, Alike(varies=frozenset({"gaps"})))


def test_what_a_sweep_varies_may_differ_and_what_it_needs_equal_may_not(tmp_path):
    sweep = two(tmp_path, lambda c: (c["protocol"].update(gap_ratio=0.25), c["config"]["grid"].update(cells=8)))
    check_alike(sweep, Alike(varies=frozenset({"protocol.gap_ratio"})))
    with pytest.raises(InputError, match="config.grid.cells: 8, but 32"):
        check_alike(sweep, Alike(varies=frozenset({"protocol.gap_ratio"}), same=("grid.cells",)))


@pytest.mark.parametrize("kind", ["fig6", "fig7", "tradeoff", "generalise"])
def test_networks_of_other_budgets_are_not_compared(tmp_path, kind):
    for name, epochs in (("default-seed0", 2), ("other-seed0", 8)):
        put(tmp_path, name, {"cvae-hm": [0.1, 0.2]}, config={"trainer.epochs": epochs})
    with pytest.raises(InputError, match="config.trainer.epochs: 8, but 2"):
        read_page(tmp_path, kind)


@pytest.mark.parametrize("kind", ["fig6", "fig7", "tradeoff", "generalise"])
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("trainer.learning_rate", 0.02),
        ("likelihood.masked", False),
        ("grid.occupied_share", 0.05),
        ("calibration_occupied_weight", 1.0),
        ("mapper.cvae-hm", {"weights": "unit"}),
    ],
)
def test_nothing_differs_but_what_a_sweep_varies(tmp_path, kind, key, value):
    usual = {"trainer.learning_rate": 0.004, "likelihood.masked": True, "grid.occupied_share": 0.15, "calibration_occupied_weight": 2.0}
    usual["mapper.cvae-hm"] = {}
    put(tmp_path, "default-seed0", {"cvae-hm": [0.1, 0.2]}, config=usual)
    put(tmp_path, "other-seed0", {"cvae-hm": [0.1, 0.2]}, config=usual | {key: value})
    with pytest.raises(InputError, match=f"other-seed0.*: config.{key}: .* in .*default-seed0"):
        read_page(tmp_path, kind)


@pytest.mark.parametrize(
    ("kind", "config"),
    [
        ("fig6", {"network.latent": 8, "network.variational": False}),
        ("fig7", {"grid.cells": 64, "grid.cluster_diameter_m": 6.4, "grid.inner_radius_m": 1.4, "augmentation.balls": 8}),
        ("tradeoff", {"grid.cells": 64, "grid.cluster_diameter_m": 6.4, "grid.inner_radius_m": 1.4, "augmentation.balls": 8}),
        ("tradeoff", {"network.latent": 8}),
        ("tradeoff", {"mapper.cvae-hm": {"flips": 1, "neighbours": 9, "inner_radius_m": 0.8, "device": "cuda"}}),
        ("generalise", {"data.train": ["hall"], "data.calibrate": [], "data.validate": "annex"}),
    ],
)
def test_what_a_sweep_varies_may_differ(tmp_path, kind, config):
    usual = {"augmentation.balls": 2, "data.train": ["annex"], "data.calibrate": ["hall"], "data.validate": "yard"}
    usual["mapper.cvae-hm"] = {"flips": 1}
    put(tmp_path, "default-seed0", {"cvae-hm": [0.1, 0.2]}, config=usual)
    put(tmp_path, "other-seed0", {"cvae-hm": [0.1, 0.2]}, config=usual | config)
    assert read_page(tmp_path, kind).markdown()


@pytest.mark.parametrize("kind", ["table1", "table2"])
@pytest.mark.parametrize(("key", "value"), [("trainer.epochs", 40), ("calibration_seeds", [100, 101]), ("data.simulated", 60)])
def test_what_was_trained_for_a_table_of_methods_was_trained_as_long(tmp_path, kind, key, value):
    """Its recipes may differ, so may the settings that nothing was trained by."""
    usual = {"trainer.epochs": 2, "trainer.steps_per_epoch": 160, "calibration_seeds": [100], "data.simulated": 0}
    put(tmp_path, "cvae-hm-seed0", {"cvae-hm": [0.1, 0.2]}, config=usual)
    put(tmp_path, "cvae-hm-paper-seed0", {"cvae-hm-paper": [0.1, 0.2]}, config=usual | {"trainer.steps_per_epoch": 80})
    put(tmp_path, "baselines-seed0", {"nearest": [0.1, 0.2]}, config=usual | {key: value}, about={"stage_seconds": {}})
    put(tmp_path, "features-seed0", {"hm": [0.1, 0.2]}, about={"stage_seconds": {}})
    assert read_page(tmp_path, kind).markdown()
    put(tmp_path, "longer-seed0", {"cae-hm": [0.1, 0.2]}, config=usual | {key: value})
    with pytest.raises(InputError, match=f"longer-seed0.*: config.{key}: .*; they can't stand in one table"):
        read_page(tmp_path, kind)


def test_other_data_and_networks_beside_the_same_sites_and_a_broken_job_are_fine(tmp_path):
    two(tmp_path, lambda c: c["data"].update(other="1234", checkpoint="5678"))
    named = {"checkpoint": "9999", "mapper.cvae-hm.reconstructor": "9999"}
    put(tmp_path, "c-seed0", {"nearest": [0.1, 0.2]}, about={"data": named})
    put(tmp_path, "e-seed0", {"nearest": [0.1, 0.2]}, about={"data": named | {"mapper.cvae-hm.reconstructor": "8888"}})
    put_failed(tmp_path, "d-seed0")
    put(tmp_path, "a-seed0/annex", {"nearest": [0.1, 0.2]}, site="annex")
    check_alike(read_sweep(tmp_path, "table1"), Alike())


def test_notes(tmp_path):
    def how(content):
        content["git"] = {"commit": "b" * 40, "dirty": True}
        content["packages"]["numpy"] = "2.1"
        content["host"] |= {"threads": 8, "numbers": "bfloat16", "filled_by": "a GPU", "trained_by": "two GPUs"}

    text = "\n".join(origin_notes(two(tmp_path, how).runs))
    assert f"- hilbertvae 0.1.0, commits {'a' * 12}, {'b' * 12}" in text
    assert "- uncommitted tree, so that no commit says what ran: b-seed0" in text
    assert "- numpy differs: 2.0 in a-seed0; 2.1 in b-seed0" in text
    gpus = "networks in bfloat16, filled by a GPU, trained by two GPUs"
    assert (
        f"an abacus, 1 thread, networks in float32; an abacus, 8 threads, {gpus}; seconds of different machines can't be compared" in text
    )
    assert origin_notes([]) == []


def test_an_installed_copy_has_no_commit(tmp_path):
    text = "\n".join(origin_notes(two(tmp_path, lambda c: c.update(git=None)).runs))
    assert f"commits {'a' * 12}, unknown" in text and "uncommitted" not in text
