"""Tables I and II: means and spreads worked out by hand, the paper's numbers beside them, and whose order holds."""

import statistics
from dataclasses import asdict

import pytest

from hilbertvae.reconstruction.settings import PaperNetworkSettings
from hilbertvae.tables.layouts import read_page
from hilbertvae.tables.methods import PAPER_LATENT, PAPER_NETWORK
from toy_sweeps import SECONDS, change, declare, lines_with, put, put_failed, rows_of_csv, scores_of

AS_IN_THE_PAPER = {"network.kind": "paper", "network.channels": [64, 128, 256, 256], "network.kernels": [9, 7, 5, 5], "network.latent": 25}


@pytest.fixture
def folder(tmp_path):
    """Ours with two training seeds, the paper's recipe with one, and the baselines."""
    declare(tmp_path, "table1", ["cvae-hm-seed0", "cvae-hm-seed1", "cvae-hm-paper-seed0", "cae-hm-seed0", "baselines-seed0"])
    ours = {"cvae-hm": [0.6, 0.8], "cvae-hm-points": scores_of([0.5, 0.7], f1=[0.6, 0.7])}
    put(tmp_path, "cvae-hm-seed0", ours, maps={"cvae-hm": {"clusters": [10, 20], "bytes": [3e6, 5e6]}})
    put(tmp_path, "cvae-hm-seed1", {"cvae-hm": [0.4, 0.4], "cvae-hm-points": scores_of([0.7, 0.9], f1=[0.8, 0.9])})
    put(tmp_path, "cvae-hm-paper-seed0", {"cvae-hm-paper": [0.1, 0.2]}, config=AS_IN_THE_PAPER | {"grid.cells": 64})
    put(tmp_path, "cae-hm-seed0", {"cae-hm-points": [0.3, 0.5]})
    put(tmp_path, "baselines-seed0", {"nearest": [0.2, 0.3], "lard-hm": scores_of([0.4, 0.4], f1=[0.65, 0.6]), "gpom": [0.9, 0.9]})
    return tmp_path


def rows(folder, name="table.csv", key="method"):
    return {row[key]: row for row in rows_of_csv(read_page(folder).csv_files()[name])}


def test_mean_over_gap_seeds_and_then_over_training_seeds(folder):
    row = rows(folder)["cvae-hm-points"]
    assert float(row["gaps_precision_mean"]) == pytest.approx(statistics.mean([0.6, 0.8]))
    assert float(row["gaps_precision_sd"]) == pytest.approx(statistics.stdev([0.6, 0.8]))
    assert row["gaps_precision_n"] == "2" and row["n"] == "2×2" and (row["training_seeds"], row["gap_seeds"]) == ("2", "2")
    one = rows(folder)["nearest"]
    assert float(one["gaps_auc_mean"]) == pytest.approx(0.25) and float(one["gaps_auc_sd"]) == pytest.approx(statistics.stdev([0.2, 0.3]))
    assert one["n"] == "1×2" and one["gaps_auc_n"] == "2"


def test_a_training_whose_map_calls_nothing_occupied_has_no_precision(tmp_path):
    silent = {"precision": [0.0, 0.0], "recall": [0.0, 0.0]}  # half is free, and a half of that, and of the rest, is called free
    first, last = {"precision": [0.8, 0.9], "recall": [0.1, 0.2]}, {"precision": [0.6, 0.7], "recall": [0.3, 0.3]}
    for seed, calls in enumerate([first, silent, last]):
        put(tmp_path, f"cvae-hm-paper-seed{seed}", {"cvae-hm-paper": scores_of([0.5, 0.5], **calls)})
    declare(tmp_path, "table1", [f"cvae-hm-paper-seed{seed}" for seed in range(3)])
    row = rows(tmp_path)["cvae-hm-paper"]
    assert float(row["gaps_precision_mean"]) == pytest.approx(statistics.mean([0.85, 0.65])) and row["gaps_precision_n"] == "2"
    assert float(row["gaps_recall_mean"]) == pytest.approx(statistics.mean([0.15, 0.0, 0.3])) and row["gaps_recall_n"] == "3"
    for seed in (0, 2):  # of maps that are all silent it stays 0
        put(tmp_path, f"cvae-hm-paper-seed{seed}", {"cvae-hm-paper": scores_of([0.5, 0.5], **silent)})
    row = rows(tmp_path)["cvae-hm-paper"]
    assert float(row["gaps_precision_mean"]) == 0 and row["gaps_precision_n"] == "3"


def test_the_paper_s_numbers_and_the_difference(folder):
    row = rows(folder)["cvae-hm-points"]
    assert (row["paper_gaps_precision"], row["paper_gaps_recall"]) == ("0.9086", "0.8629")
    assert float(row["difference_precision_mean"]) == pytest.approx(0.7 - 0.9086)
    assert float(row["difference_precision_sd"]) == pytest.approx(float(row["gaps_precision_sd"]))
    shown = lines_with(read_page(folder).markdown(), "cvae-hm-points")[0]
    assert shown[5:8] == ["90.86 / 86.29", "70.0±14.1 / 70.0±14.1", "-20.9±14.1 / -16.3±14.1"]
    assert float(row["difference_fitted_precision_mean"]) == pytest.approx(float(row["fitted_precision_mean"]) - 0.9664)
    assert rows(folder)["nearest"]["paper_gaps_precision"] == ""


def test_rows_stand_in_the_paper_s_order_then_ours_then_the_others(folder):
    assert list(rows(folder)) == [
        "gpom", "lard-hm", "cae-hm-paper", "cvae-hm-paper", "cae-hm-points", "cvae-hm-points", "cvae-hm", "nearest",
    ]  # fmt: skip


def test_costs(folder):
    row = rows(folder)["cvae-hm"]
    assert float(row["clusters_mean"]) == 15 and float(row["map_bytes_mean"]) == 4e6
    assert float(row["fit_s_mean"]) == statistics.mean(SECONDS["fit"]) and float(row["query_s_per_million_mean"]) == 0.5
    assert float(row["train_s_mean"]) == 90 and float(row["grids_s_mean"]) == 20
    assert rows(folder)["nearest"]["train_s_mean"] == ""
    (_, costs) = lines_with(read_page(folder).markdown(), "cvae-hm")
    assert costs[-2:] == ["15.0±7.1", "4.00±1.41"]


def test_the_paper_s_order_pair_by_pair(folder):
    order = {row["mappers"]: row for row in rows_of_csv(read_page(folder).csv_files()["table-order.csv"])}
    ours = order["cvae-hm-points > lard-hm"]
    found = [0.6 - 0.65, 0.7 - 0.6, 0.8 - 0.65, 0.9 - 0.6]
    assert float(ours["difference_mean"]) == pytest.approx(statistics.mean(found))
    assert float(ours["difference_sd"]) == pytest.approx(statistics.stdev([statistics.mean(found[:2]), statistics.mean(found[2:])]))
    assert ours["better_in"] == "3 of 4" and ours["agrees"] == "yes"
    assert order["cvae-hm-paper > lard-hm"]["agrees"] == "no"
    assert order["cae-hm-points > gpom"]["agrees"] == "no" and order["cae-hm-paper > gpom"]["agrees"] == "-"
    assert float(ours["paper_better_f1"]) == pytest.approx(2 * 0.9086 * 0.8629 / (0.9086 + 0.8629))
    assert list(dict.fromkeys(row["pair"] for row in order.values())) == [
        "CVAE-HM > LARD-HM", "CVAE-HM > CAE-HM", "CVAE-HM > GPOM", "LARD-HM > CAE-HM", "LARD-HM > GPOM", "CAE-HM > GPOM",
    ]  # fmt: skip


def test_neither_is_ahead_where_both_say_nothing(folder):
    put(folder, "cvae-hm-paper-seed0", {"cvae-hm-paper": [0.0, 0.0]})
    put(folder, "baselines-seed0", {"lard-hm": [0.0, 0.0]})
    order = {row["mappers"]: row for row in rows_of_csv(read_page(folder).csv_files()["table-order.csv"])}
    assert order["cvae-hm-paper > lard-hm"]["agrees"] == "tie"
    assert "calls nothing in a gap occupied" in rows(folder)["lard-hm"]["note"]
    assert "calls nothing" not in rows(folder)["cvae-hm"]["note"]


def test_the_figure_has_no_precision_of_a_method_that_finds_nothing(folder):
    put(folder, "baselines-seed0", {"lard-hm": scores_of([0.4, 0.4], precision=[0.0, 0.0], recall=[0.0, 0.0]), "hm": [0.3, 0.3]})
    observed, gaps = read_page(folder).figure().axes
    drawn = {str(part.get_label()): sorted(part[0].get_xdata()) for part in gaps.containers}
    assert 0 in drawn["recall, here"] and 0 not in drawn["precision, here"]
    assert len(drawn["precision, here"]) == len(drawn["recall, here"]) - 1
    assert len({len(part[0].get_xdata()) for part in observed.containers}) == 1


def test_the_ceiling_stands_below(folder):
    (line,) = (line for line in read_page(folder).markdown().splitlines() if line.startswith("Ceiling"))
    assert line.endswith("P / R (%): hall, points 97.0 / 96.0.")


def test_what_is_missing_and_what_failed_is_named(folder):
    declare(folder, "table1", ["cvae-hm-seed0", "cvae-hm-seed1", "cvae-hm-paper-seed0", "cae-hm-paper-seed0", "cae-hm-seed0", "hm-seed0"])
    put_failed(folder, "cae-hm-seed0", "RuntimeError: out of\nmemory")
    put(folder, "cvae-hm-seed1", {"cvae-hm": [0.4, 0.4]}, failed={"cvae-hm-points": "ValueError: NaN", "slow": "TimeoutError: 1 h"})
    page = read_page(folder)
    text, found = page.markdown(), rows(folder)
    assert "- missing: cae-hm-paper-seed0 has no result.json" in text and "- missing: hm-seed0 has no result.json" in text
    assert "- failed: cae-hm-seed0, run: RuntimeError: out of memory" in text
    assert "- failed: cvae-hm-seed1, cvae-hm-points: ValueError: NaN" in text
    assert "- left out: baselines-seed0, which is no job of this sweep" in text
    status = {name: row["status"] for name, row in found.items()}
    assert status["cae-hm-paper"] == "missing" and status["cae-hm"] == "failed" and status["gpom"] == "missing"
    assert status["slow"] == "failed" and "TimeoutError: 1 h" in found["slow"]["note"]
    assert found["cvae-hm-points"]["n"] == "1×2" and "failed in cvae-hm-seed1: ValueError: NaN" in found["cvae-hm-points"]["note"]
    assert lines_with(text, "cae-hm")[0][2].startswith("failed") and lines_with(text, "gpom")[0][2].startswith("missing")


def test_notes_say_what_the_network_was(folder):
    found = rows(folder)
    assert found["cvae-hm-paper"]["note"] == "the paper's network: paper 64/128/256/256, 64 cells, latent 25"
    assert found["cvae-hm"]["note"] == "gated 8/16, 32 cells, latent 4; calibrated for voxels"
    put(folder, "cvae-hm-paper-seed0", {"cvae-hm-paper": [0.1, 0.2]}, config=AS_IN_THE_PAPER | {"network.channels": [4]})
    note = rows(folder)["cvae-hm-paper"]["note"]
    assert note == "the paper's recipe on another network than its baseline: paper 4, 32 cells, latent 25"


def test_a_baseline_in_several_runs_is_one_row_with_one_run(folder):
    put(folder, "cvae-hm-seed0", {"cvae-hm": [0.6, 0.8], "nearest": [0.2, 0.3]})
    found = rows(folder)["nearest"]
    assert found["n"] == "1×2" and float(found["gaps_auc_sd"]) > 0


def test_further_sites_have_tables_of_their_own(folder):
    put(folder, "cvae-hm-seed0/orebro", {"cvae-hm": [0.1, 0.3]}, site="orebro")
    page = read_page(folder)
    found = rows_of_csv(page.csv_files()["table.csv"])
    assert [row["site"] for row in found if row["method"] == "cvae-hm"] == ["hall", "orebro"]
    assert "## hall, gaps of 2.5 m" in page.markdown() and "## orebro, gaps of 2.5 m" in page.markdown()


def test_each_site_has_gaps_of_its_own(tmp_path):
    for site, at in (("hall", 0.0), ("orebro", 5.0)):
        gaps = [{"seed": seed, "centres": [[at, 1.0]], "radius_m": [1.25], "share": 0.1} for seed in (0, 1)]
        below = "" if site == "hall" else f"/{site}"
        for job, mapper in (("cvae-hm-seed0", "cvae-hm"), ("baselines-seed0", "nearest")):
            change(put(tmp_path, job + below, {mapper: [0.1, 0.3]}, site=site), lambda content, gaps=gaps: content.update(gaps=gaps))
    text = read_page(tmp_path, "table1").markdown()
    assert "## hall" in text and "## orebro" in text


def test_occlusion_stands_there_where_it_was_scored(folder):
    assert "occluded" not in read_page(folder).markdown()
    scores = scores_of([0.2, 0.3])
    scores["voxels"]["occluded-sparse"] = scores["voxels"]["gaps"]
    put(folder, "baselines-seed0", {"nearest": scores})
    assert "occluded, sparse, voxels: AUC (%)" in read_page(folder).markdown()
    assert float(rows(folder)["nearest"]["occluded-sparse_auc_mean"]) == pytest.approx(0.25)


def test_in_3d_the_paper_s_second_table(tmp_path):
    put(tmp_path, "baselines-seed0", {"octomap": [0.1, 0.2]}, dimension=3)
    page = read_page(tmp_path, "table2")
    assert "Table II" in page.markdown() and "OctoMap is fed labelled points" in page.markdown()
    assert rows_of_csv(page.csv_files()["table.csv"])[0]["paper_gaps_precision"] == "0.1685"
    scores = scores_of([0.1, 0.2])
    scores["voxels"]["gaps-above-ground"] = scores["voxels"]["gaps"]
    put(tmp_path, "baselines-seed0", {"octomap": scores}, dimension=3)
    assert "gaps above ground, voxels: best F1 (%)" in read_page(tmp_path, "table2").markdown()


def test_the_paper_s_network_is_the_one_that_can_be_chosen():
    settings = asdict(PaperNetworkSettings())
    assert {key: settings[key] for key in PAPER_NETWORK} == PAPER_NETWORK and settings["latent"] == PAPER_LATENT[2]


def test_a_row_made_by_uncommitted_code_says_so(folder):
    put(folder, "cae-hm-seed0", {"cae-hm-points": [0.3, 0.5]}, about={"git": {"commit": "b" * 40, "dirty": True}})
    found = rows(folder)
    assert found["cae-hm-points"]["note"].endswith("; uncommitted tree") and "uncommitted" not in found["nearest"]["note"]
