"""Each kind of sweep on results written by hand: rows, differences, figures; numbers are worked out here."""

import statistics

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.drawing.canvas import pixels
from hilbertvae.tables.cases import natural
from hilbertvae.tables.layouts import LAYOUTS, read_page
from toy_sweeps import declare, put, put_failed, rows_of_csv, scores_of


def table(page, name="table.csv"):
    return rows_of_csv(page.csv_files()[name])


def by(rows, key):
    return {row[key]: row for row in rows}


def inked(page):
    picture = pixels(page.figure())
    return np.ptp(picture) > 128 and (picture < 128).any(axis=2).mean() > 0.002


@pytest.mark.parametrize("kind", [kind for kind in LAYOUTS if kind != "fig2"])
def test_a_sweep_of_which_every_job_broke_still_has_a_table(tmp_path, kind):
    declare(tmp_path, kind, ["a-seed0", "b-seed0"])
    put_failed(tmp_path, "a-seed0", "MemoryError: too large")
    page = read_page(tmp_path)
    assert "- failed: a-seed0, run: MemoryError: too large" in page.markdown() and "- missing: b-seed0" in page.markdown()
    assert by(table(page), next(iter(table(page)[0])))["a"]["status"] == "failed"
    assert pixels(page.figure()).shape[2] == 3


def test_latent(tmp_path):
    declare(tmp_path, "fig6", [f"{latent}-{kind}-seed0" for latent in (4, 16) for kind in ("true", "false")] + ["64-true-seed0"])
    for latent in (4, 16):
        for variational, name in ((True, "cvae-hm-paper"), (False, "cae-hm-paper")):
            config = {"network.latent": latent, "network.variational": variational}
            values = [latent / 100, latent / 100 + 0.2 * variational]
            put(tmp_path, f"{latent}-{str(variational).lower()}-seed0", {name: scores_of([0.9, 0.8], f1=values)}, config=config)
    page = read_page(tmp_path)
    rows = table(page)
    assert [(row["network"], row["latent"]) for row in rows] == [("CVAE", "4"), ("CVAE", "16"), ("CAE", "4"), ("CAE", "16"), ("", "")]
    assert float(rows[1]["gaps_f1_mean"]) == pytest.approx(0.26) and float(rows[1]["observed_f1_mean"]) == pytest.approx(0.85)
    assert rows[2]["mapper"] == "cae-hm-paper" and (rows[4]["case"], rows[4]["status"]) == ("64-true", "missing")
    assert inked(page)


def test_latent_needs_its_setting(tmp_path):
    put(tmp_path, "a-seed0", {"cvae-hm": [0.1, 0.2]}, config={"network": {}})
    with pytest.raises(InputError, match="config.network.variational: missing"):
        read_page(tmp_path, "fig6")


def test_gap_size(tmp_path):
    for cluster, values in ((4.0, {0.25: [0.8, 0.6], 0.5: [0.4, 0.3]}), (8.0, {0.25: [0.7, 0.65], 0.5: [0.5, 0.5]})):
        for ratio, f1 in values.items():
            job = f"{cluster:g}m-gap{ratio}-seed0"
            put(
                tmp_path, job, {"cvae-hm-points": scores_of([0.9, 0.9], f1=f1)},
                config={"grid.cluster_diameter_m": cluster}, protocol={"gap_ratio": ratio},
            )  # fmt: skip
    page = read_page(tmp_path, "fig7")
    rows = {(row["cluster_m"], row["gap_m"]): row for row in table(page)}
    assert list(rows) == [("4.0", "1.25"), ("4.0", "2.5"), ("8.0", "1.25"), ("8.0", "2.5")]
    assert float(rows["8.0", "2.5"]["gaps_f1_mean"]) == 0.5 and float(rows["4.0", "2.5"]["ratio"]) == 0.625
    best = by(table(page, "table-best.csv"), "gap_m")
    assert best["1.25"]["cluster_m"] == "4.0" and best["1.25"]["better_in"] == "1 of 2"
    assert float(best["1.25"]["difference_mean"]) == pytest.approx(statistics.mean([0.1, -0.05]))
    assert best["2.5"]["cluster_m"] == "8.0" and best["2.5"]["better_in"] == "2 of 2"
    assert inked(page)


def test_gaps_of_other_places_are_still_refused(tmp_path):
    put(tmp_path, "a-seed0", {"cvae-hm": [0.1, 0.2]})
    put(tmp_path, "b-seed0", {"cvae-hm": [0.1, 0.2]}, protocol={"centred": True})
    with pytest.raises(InputError, match="protocol.centred: True, but False"):
        read_page(tmp_path, "fig7")


def test_tradeoff(tmp_path):
    def case(name, auc, config, seconds=1.0):
        times = {"cvae-hm": {"fit": [seconds] * 2, "query_per_million": [2 * seconds] * 2}}
        put(tmp_path, f"{name}-seed0", {"cvae-hm": scores_of([0.5, 0.5], auc=auc)}, config=config, seconds=times)

    case("default", [0.8, 0.8], {})
    case("k-1", [0.7, 0.6], {"mapper.cvae-hm.neighbours": 1}, 0.5)
    case("cells-64", [0.9, 0.9], {"grid.cells": 64, "grid.inner_radius_m": 2.8}, 3.0)
    case("radius-0.8m", [0.85, 0.85], {"mapper.cvae-hm.inner_radius_m": 0.8}, 2.0)
    case("both", [0.85, 0.85], {"network.latent": 8, "grid.cells": 16}, 2.0)
    page = read_page(tmp_path, "tradeoff")
    rows = by(table(page), "case")
    assert next(iter(rows)) == "default"
    assert {name: (row["varied"], row["value"]) for name, row in rows.items()} == {
        "default": ("nothing", "default"), "k-1": ("K", "1"), "cells-64": ("grid cells", "64"), "radius-0.8m": ("inner radius (m)", "0.8"),
        "both": ("grid cells and latent", "16 and 8"),
    }  # fmt: skip
    assert float(rows["cells-64"]["fit_s_mean"]) == 3 and float(rows["k-1"]["gaps_voxels_auc_mean"]) == pytest.approx(0.65)
    assert inked(page)
    lines, _ = page.figure().axes[0].get_legend_handles_labels()
    assert len({line[0].get_marker() for line in lines}) == len(lines) == 4


def test_tradeoff_of_a_network_without_sampling_reads_the_mapper_as_it_is_configured(tmp_path):
    put(tmp_path, "default-seed0", {"cae-hm": [0.5, 0.5]})
    put(tmp_path, "k-1-seed0", {"cae-hm": [0.5, 0.5]}, config={"mapper.cvae-hm.neighbours": 1})
    assert by(table(read_page(tmp_path, "tradeoff")), "case")["k-1"]["varied"] == "K"


def test_ablation(tmp_path):
    declare(tmp_path, "ablation", ["default-seed0", "default-seed1", "no-skips-seed0", "no-skips-seed1", "turned-seed0", "gone-seed0"])
    put(tmp_path, "default-seed0", {"cvae-hm": [0.8, 0.7], "cvae-hm-points": [0.9, 0.9]})
    put(tmp_path, "default-seed1", {"cvae-hm": [0.6, 0.6], "cvae-hm-points": [0.9, 0.9]})
    config = {"network.skips": False}
    put(tmp_path, "no-skips-seed0", {"cvae-hm": [0.7, 0.8], "cvae-hm-points": [0.8, 0.8]}, config=config)
    put(tmp_path, "no-skips-seed1", {"cvae-hm": [0.5, 0.4], "cvae-hm-points": [0.8, 0.8]}, config=config)
    put(tmp_path, "turned-seed0", {"cvae-hm": [0.9, 0.9], "cvae-hm-points": [0.95, 0.95]}, config={"grid.frame": {"rotation": "full"}})
    page = read_page(tmp_path)
    rows = by(table(page), "case")
    assert list(rows) == ["default", "no-skips", "turned", "gone"] and rows["gone"]["status"] == "missing"
    found = [[-0.1, 0.1], [-0.1, -0.2]]
    row = rows["no-skips"]
    assert float(row["gaps_voxels_auc_difference_mean"]) == pytest.approx(statistics.mean(map(statistics.mean, found)))
    assert float(row["gaps_voxels_auc_difference_sd"]) == pytest.approx(statistics.stdev(map(statistics.mean, found)))
    assert row["gaps_voxels_auc_worse"] == "3 of 4" and row["gaps_auc_worse"] == "4 of 4" and row["switched"] == "network.skips=False"
    assert float(rows["turned"]["gaps_auc_difference_mean"]) == pytest.approx(0.05) and rows["turned"]["n"] == "1×2"
    assert rows["turned"]["switched"] == "grid.frame.rotation=full"
    assert rows["default"]["gaps_auc_difference_mean"] == "" and rows["default"]["switched"] == "-"
    assert inked(page)


def test_where_the_map_of_one_run_failed_no_other_stands_in_for_it(tmp_path):
    """A map that is calibrated for voxels has other scores on points: the run is left out of the columns that it has no map for."""
    put(tmp_path, "default-seed0", {"cvae-hm": [0.1, 0.1]}, failed={"cvae-hm-points": "MemoryError: no"})
    put(tmp_path, "default-seed1", {"cvae-hm": [0.1, 0.1], "cvae-hm-points": [0.9, 0.9]})
    for seed in (0, 1):
        put(tmp_path, f"no-skips-seed{seed}", {"cvae-hm": [0.2, 0.2], "cvae-hm-points": [0.8, 0.8]})
    put(tmp_path, "lone-seed0", {"cvae-hm": [0.1, 0.1]}, failed={"cvae-hm-points": "MemoryError: no"})
    rows = by(table(read_page(tmp_path, "ablation")), "case")
    assert float(rows["default"]["gaps_auc_mean"]) == 0.9 and float(rows["default"]["gaps_voxels_auc_mean"]) == 0.1
    assert float(rows["no-skips"]["gaps_auc_difference_mean"]) == pytest.approx(-0.1) and rows["no-skips"]["gaps_auc_worse"] == "2 of 2"
    assert rows["no-skips"]["gaps_voxels_auc_worse"] == "0 of 4"
    assert rows["lone"]["gaps_auc_mean"] == rows["lone"]["gaps_auc_difference_mean"] == "" and rows["lone"]["gaps_voxels_auc_mean"] != ""


def test_differences_of_fewer_trainings_than_n_say_so(tmp_path):
    for case, seeds in (("default", (0, 2)), ("no-skips", (0, 1, 2)), ("turned", (0, 2)), ("other", (1,))):
        for seed in seeds:
            put(tmp_path, f"{case}-seed{seed}", {"cvae-hm": [0.2, 0.3], "cvae-hm-points": [0.8, 0.8]})
    rows = by(table(read_page(tmp_path, "ablation")), "case")
    assert rows["no-skips"]["n"] == "3×2" and rows["no-skips"]["note"].startswith("differences of 2 of 3 training seeds; ")
    assert rows["other"]["note"].startswith("differences of 0 of 1 training seeds; ")
    assert "differences" not in rows["default"]["note"] + rows["turned"]["note"]


def test_n_and_spread_are_of_the_trainings_that_were_scored(tmp_path):
    for seed in (0, 1, 2):
        put(tmp_path, f"default-seed{seed}", {"cvae-hm": [0.8, 0.7]})
        put(tmp_path, f"other-seed{seed}", {"cvae-hm": [0.6, 0.5]} if seed == 0 else {}, failed={} if seed == 0 else {"cvae-hm": "no"})
    row = by(table(read_page(tmp_path, "ablation")), "case")["other"]
    assert (row["n"], row["training_seeds"]) == ("1×2", "1") and row["gaps_voxels_auc_worse"] == "2 of 2"
    assert float(row["gaps_voxels_auc_sd"]) == pytest.approx(statistics.stdev([0.6, 0.5]))  # of gap seeds, as of any single training


@pytest.mark.parametrize("key", ["calibration_occupied_weight", "validation_gap_m"])
def test_ablation_names_switches_of_the_calibration(tmp_path, key):
    put(tmp_path, "default-seed0", {"cvae-hm": [0.7, 0.8]}, config={key: 2.0})
    put(tmp_path, "other-seed0", {"cvae-hm": [0.7, 0.8]}, config={key: 1.0})
    assert by(table(read_page(tmp_path, "ablation")), "case")["other"]["switched"] == f"{key}=1.0"


def test_ablation_without_its_default_has_no_differences(tmp_path):
    put(tmp_path, "no-skips-seed0", {"cvae-hm": [0.7, 0.8]})
    page = read_page(tmp_path, "ablation")
    row = table(page)[0]
    assert "No case `default` was scored: nothing to differ from." in page.markdown() and "paired by" not in page.markdown()
    assert row["gaps_voxels_auc_difference_mean"] == "" and float(row["gaps_voxels_auc_mean"]) == pytest.approx(0.75)


def test_sites_left_out_at_two_budgets_are_no_one_table(tmp_path):
    for site, epochs in (("north", 2), ("south", 3)):
        put(tmp_path, f"{site}-seed0", {"cvae-hm": [0.5, 0.5]}, site=site, config={"trainer.epochs": epochs})
    with pytest.raises(InputError, match="config.trainer.epochs: 3, but 2"):
        read_page(tmp_path, "generalise")


def test_generalise(tmp_path):
    declare(tmp_path, "generalise", ["north-seed0", "south-seed0", "west-seed0"])
    for site, ours, nearest, hm in (("north", [0.6, 0.8], [0.5, 0.5], [0.1, 0.9]), ("south", [0.4, 0.4], [0.2, 0.1], [0.5, 0.6])):
        mappers = {"cvae-hm": ours, "cvae-hm-points": ours, "nearest": nearest, "hm": hm, "gap-centre": [1.0, 1.0]}
        put(tmp_path, f"{site}-seed0", mappers, site=site)
    page = read_page(tmp_path)
    rows = by(table(page), "case")
    assert rows["north"]["gaps_points_f1_which"] == "nearest" and rows["south"]["gaps_points_f1_which"] == "hm"
    assert float(rows["north"]["gaps_points_f1_difference_mean"]) == pytest.approx(0.2)
    assert rows["north"]["gaps_points_f1_better"] == "2 of 2"
    assert float(rows["south"]["gaps_voxels_auc_difference_mean"]) == pytest.approx(-0.15)
    assert (rows["west"]["status"], rows["west"]["site"]) == ("missing", "-")  # not a site that another row is of
    every = rows["all sites"]
    assert float(every["gaps_points_f1_mean"]) == pytest.approx(0.55) and every["n"] == "2 sites" and every["gaps_points_f1_n"] == "2"
    assert float(every["gaps_points_f1_difference_sd"]) == pytest.approx(statistics.stdev([0.2, -0.15]))
    assert inked(page)


def test_all_sites_are_those_that_ours_and_a_baseline_were_scored_on(tmp_path):
    put(tmp_path, "north-seed0", {"cvae-hm": [0.6, 0.8], "cvae-hm-points": [0.6, 0.8], "nearest": [0.5, 0.5]}, site="north")
    put(tmp_path, "south-seed0", {"cvae-hm": [0.4, 0.4], "cvae-hm-points": [0.4, 0.4]}, site="south", failed={"nearest": "no"})
    put(tmp_path, "west-seed0", {"cvae-hm": [0.9, 0.9], "nearest": [0.6, 0.6]}, site="west", failed={"cvae-hm-points": "no"})
    every = by(table(read_page(tmp_path, "generalise")), "case")["all sites"]
    for key, ours, theirs in (("gaps_points_f1", 0.7, 0.5), ("gaps_voxels_auc", 0.8, 0.55)):
        found = [float(every[f"{key}{part}_mean"]) for part in ("", "_baseline", "_difference")]
        assert found == pytest.approx([ours, theirs, ours - theirs])
    assert every["n"] == "3 sites" and "points, F1 at the cut: 1 of 3 sites" in every["note"] and "voxels, AUC: 2 of 3" in every["note"]


def test_a_site_s_name_is_no_formula(tmp_path):
    put(tmp_path, "north-seed0", {"cvae-hm-points": [0.6, 0.8], "cvae-hm": [0.6, 0.8], "nearest": [0.5, 0.6]}, site="drive_$1_$2")
    figure = read_page(tmp_path, "generalise").figure()
    assert "drive_$1_$2" in [label.get_text() for label in figure.axes[0].get_yticklabels()]
    figure.draw_without_rendering()


def test_generalise_pairs_a_baseline_of_one_run_with_every_training(tmp_path):
    for seed, ours in ((0, [0.6, 0.8]), (1, [0.8, 0.8])):
        put(tmp_path, f"north-seed{seed}", {"cvae-hm-points": ours, "nearest": [0.5, 0.6]})
    (row,) = table(read_page(tmp_path, "generalise"))
    assert row["gaps_points_f1_better"] == "4 of 4"
    assert float(row["gaps_points_f1_difference_mean"]) == pytest.approx(statistics.mean([0.15, 0.25]))
    assert float(row["gaps_points_f1_baseline_sd"]) == pytest.approx(statistics.stdev([0.5, 0.6]))


def test_cases_stand_in_the_order_of_their_numbers():
    names = ["k-9", "default", "k-10", "k-1", "dropout-0.25", "dropout-0.3", "2m"]
    assert sorted(names, key=natural) == ["2m", "default", "dropout-0.25", "dropout-0.3", "k-1", "k-9", "k-10"]
    assert sorted([(True, "k-9"), (False, "z"), (True, "k-10")], key=natural) == [(False, "z"), (True, "k-9"), (True, "k-10")]
    assert sorted([(12.8, 2.5), (3.2, 5.0)], key=natural) == [(3.2, 5.0), (12.8, 2.5)]
