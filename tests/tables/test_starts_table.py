"""Fig. 2: times, and potentials relative to k-means++ cloud by cloud; files that are refused."""

import json
import statistics

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.drawing.canvas import pixels
from hilbertvae.tables.clustering import read_starts
from hilbertvae.tables.layouts import read_page
from toy_sweeps import change, declare, lines_with, rows_of_csv

POTENTIALS = {
    ("quick_means", 0): [6.0, 3.0],
    ("quick_means", 1): [9.0, 4.0],
    ("kmeans_plus_plus", 0): [4.0, 2.0],
    ("kmeans_plus_plus", 1): [3.0, 2.0],
}


def _row(start, points, seed):
    potentials = [p * points / 1000 for p in POTENTIALS.get((start, seed), [8.0, 5.0])]
    found = {"start": start, "points": points, "seed": seed, "seconds": 0.1 * points / 1000 + 0.1 * seed}
    return found | {"clusters": 50 + seed, "potentials_m2": potentials}


def put_starts(folder, start, rows=None, **others):
    if rows is None:
        rows = [_row(start, points, seed) for points in (1000, 2000) for seed in (0, 1)]
    content = {
        "schema_version": 1, "status": "ok", "config": {"case": start, "study": {"seeds": [0, 1]}}, "packages": {"hilbertvae": "0.1.0"},
        "git": {"commit": "c" * 40, "dirty": False}, "rows": rows,
    } | others  # fmt: skip
    path = folder / f"{start}-seed0" / "clustering.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("other", "key"),
    [
        ({"config": {"case": "random", "study": {"seeds": [0, 1], "cloud": "returns"}, "data": {"test": ["stairs"]}}}, "config.data.test"),
        ({"data": {"hall": "ffff"}}, "data"),
    ],
)
def test_returns_of_another_site_are_refused(tmp_path, other, key):
    config = {"case": "random", "study": {"seeds": [0, 1], "cloud": "returns"}, "data": {"test": ["hall"]}}
    usual = {"config": config, "data": {"hall": "00ff"}}
    declare(tmp_path, "fig2", ["kmeans_plus_plus-seed0", "random-seed0"])
    put_starts(tmp_path, "kmeans_plus_plus", **usual)
    put_starts(tmp_path, "random", **usual | other)
    with pytest.raises(InputError, match=f"random-seed0.*: {key}: .*, but .* in .*; they can't stand in one table"):
        read_starts(tmp_path)


def test_times_and_relative_potentials(tmp_path):
    declare(tmp_path, "fig2", ["quick_means-seed0", "kmeans_plus_plus-seed0", "random-seed0", "ask_means-seed0"])
    for start in ("random", "kmeans_plus_plus", "quick_means"):
        put_starts(tmp_path, start)
    page = read_page(tmp_path)
    rows = {(row["start"], row["points"]): row for row in rows_of_csv(page.csv_files()["table.csv"])}
    assert [row["name"] for row in rows.values()] == ["Quick-Means"] * 2 + ["k-means++"] * 2 + ["random"] * 2
    row = rows["quick_means", "2000"]
    assert float(row["seconds_mean"]) == pytest.approx(0.25) and float(row["seconds_sd"]) == pytest.approx(statistics.stdev([0.2, 0.3]))
    assert float(row["clusters_mean"]) == 50.5 and row["n"] == "2"
    assert float(row["relative_0_mean"]) == pytest.approx(statistics.mean([6 / 4, 9 / 3]))
    assert float(row["relative_1_sd"]) == pytest.approx(statistics.stdev([3 / 2, 4 / 2]))
    assert float(row["potential_0_m2_mean"]) == pytest.approx(statistics.mean([12.0, 18.0]))
    assert float(rows["kmeans_plus_plus", "1000"]["relative_1_mean"]) == 1
    text = page.markdown()
    assert lines_with(text, "Quick-Means")[2][3:] == ["2.250±1.061", "1.750±0.354"]
    assert "- missing: ask_means-seed0 has no clustering.json" in text and f"commit {'c' * 12}" in text
    assert np.ptp(pixels(page.figure())) > 128


def test_without_k_means_plus_plus_there_is_nothing_to_be_relative_to(tmp_path):
    put_starts(tmp_path, "random")
    row = rows_of_csv(read_page(tmp_path, "fig2").csv_files()["table.csv"])[0]
    assert row["relative_0_mean"] == "" and float(row["potential_0_m2_mean"]) == 8


def test_a_failed_job(tmp_path):
    put_starts(tmp_path, "random")
    put_starts(tmp_path, "ask_means", rows=[], status="failed", failed={"run": "ValueError: no\nthreshold"}, packages={})
    assert "- failed: ask_means-seed0, run: ValueError: no threshold" in read_page(tmp_path, "fig2").markdown()


def test_all_failed(tmp_path):
    put_starts(tmp_path, "random", rows=[], status="failed")
    page = read_page(tmp_path, "fig2")
    assert "- failed: random-seed0, run: no message" in page.markdown() and pixels(page.figure()).shape[2] == 3


def row(content):
    return content["rows"][1]


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (lambda c: c.pop("schema_version"), "schema_version: expected 1, got None"),
        (lambda c: c.update(status="done"), "status: expected ok or failed, got 'done'"),
        (lambda c: c.update(rows={}), "rows: expected a list"),
        (lambda c: c.update(config=[]), "config: expected an object"),
        (lambda c: c.update(failed="yes"), "failed: expected an object"),
        (lambda c: c.update(rows=[3]), "rows[0]: expected an object"),
        (lambda c: row(c).update(start=3), "rows[1].start: expected text"),
        (lambda c: row(c).update(points=0), "rows[1].points: expected a whole number from 1 on, got 0"),
        (lambda c: row(c).update(seed=True), "rows[1].seed: expected a whole number"),
        (lambda c: row(c).update(seconds=-1), "rows[1].seconds: expected a number of at least 0"),
        (lambda c: row(c).update(potentials_m2=[1, None]), "rows[1].potentials_m2: expected a list of numbers"),
        (lambda c: row(c).update(potentials_m2=[float("nan")]), "rows[1].potentials_m2: expected a list of numbers"),
        (lambda c: c["packages"].update(hilbertvae="9"), "packages.hilbertvae: '9', but '0.1.0' in"),
        (lambda c: c.update(packages={}), "packages.hilbertvae: missing"),
        (lambda c: c["config"].update(study={"seeds": [4]}), "config.study: {'seeds': [4]}, but"),
        (lambda c: row(c).update(start="kmeans_plus_plus"), "rows: kmeans_plus_plus of 1000 points, seed 1, is also in"),
    ],
)
def test_refused(tmp_path, how, message):
    put_starts(tmp_path, "kmeans_plus_plus")
    path = put_starts(tmp_path, "random")
    change(path, how)
    with pytest.raises(InputError) as error:
        read_starts(tmp_path, "fig2")
    assert str(path) in str(error.value) and message in str(error.value)


def test_nothing_there(tmp_path):
    with pytest.raises(InputError, match="expected <job>/clustering.json, found none"):
        read_page(tmp_path, "fig2")
