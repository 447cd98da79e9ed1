"""Every benchmark runs at its tiny size and leaves a whole JSON file."""

import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
NEEDED = {
    "quick_means": ["faiss"],
    "queries": ["octomap", "embreex"],
    "map_site": ["embreex"],
    "training_throughput": [],
    "reconstruction": ["embreex"],
    "large_cloud": ["embreex"],
    "launchers": ["embreex"],
    "streaming": ["octomap", "embreex"],
    "map_command": ["octomap", "embreex", "trimesh"],
    "octomap_rays": ["octomap", "embreex"],
    "rooms": ["embreex", "shapely"],
}


@pytest.fixture(autouse=True)
def beside_each_other(monkeypatch):
    """As if run by `python benchmarks/<name>.py`: the scripts find what they share."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setattr(sys, "argv", ["benchmark", "--quick"])


FILES = {"map_site": "map_intel", "streaming": "streaming_simulated_1", "map_command": "map_command_simulated"}
"""Of another name than the script, since there is one for each site."""


@pytest.mark.parametrize("name", NEEDED)
def test_the_json_says_what_was_measured_and_on_what(name, tmp_path, capsys):
    for package in NEEDED[name]:
        pytest.importorskip(package)
    import_module(name).main(["--quick", f"--output={tmp_path}"])

    assert [file.name for file in tmp_path.iterdir()] == [f"{FILES.get(name, name)}.json"]
    written = json.loads((tmp_path / f"{FILES.get(name, name)}.json").read_text())
    assert written["benchmark"] == FILES.get(name, name) and written["quick"] is True
    assert written["rows"] and all(any(isinstance(value, float) and value > 0 for value in row.values()) for row in written["rows"])
    assert all({"what", "wanted", "found", "met"} == set(row) for row in written["targets"])
    assert written["machine"]["cpu"] and written["versions"]["numpy"] and "commit" in written["git"]
    assert written["command"] == ["python", f"benchmarks/{name}.py", "--quick"]
    printed = capsys.readouterr().out
    assert all(next(iter(row.values())) in printed for row in written["rows"])


def test_a_large_cloud_of_three_dimensions(tmp_path):
    pytest.importorskip("embreex")
    import_module("large_cloud").main(["--quick", "--dimension=3", f"--output={tmp_path}"])
    written = json.loads((tmp_path / "large_cloud_3d.json").read_text())
    assert [row["points"] >= count for row, count in zip(written["rows"], (5_000, 10_000), strict=True)] == [True, True]
    assert written["facts"]["dimension"] == 3 and written["facts"]["checkpoint"] == "3d" and len(written["targets"]) == 2
    for row in written["rows"]:  # as many queries are asked of each cloud, which must not count as time of its points
        assert row["us per point"] == pytest.approx(row["fit"] / row["points"] * 1e6) and row["seconds"] == row["fit"] + row["query"]


def test_queries_are_equal_to_their_twins(tmp_path):
    for package in NEEDED["queries"]:
        pytest.importorskip(package)
    import_module("queries").main(["--quick", f"--output={tmp_path}"])
    targets = json.loads((tmp_path / "queries.json").read_text())["targets"]
    assert [row["met"] for row in targets if row["wanted"] == "0"] == [True, True]


def test_quick_numbers_replace_no_committed_ones(tmp_path, monkeypatch):
    measuring = import_module("measuring")
    monkeypatch.setattr(measuring, "RESULTS", tmp_path / "committed")
    monkeypatch.setattr(measuring, "QUICK_RESULTS", tmp_path / "quick")
    for words, where in ((["--quick"], "quick"), ([], "committed"), (["--quick", f"--output={tmp_path / 'own'}"], "own")):
        given = measuring.arguments("About.").parse_args(words)
        assert measuring.report("anything", given, [{"what": "a", "seconds": 1.0}], [], {}) == tmp_path / where / "anything.json"


def test_queries_of_another_site_have_a_file_of_their_own(tmp_path):
    for package in NEEDED["queries"]:
        pytest.importorskip(package)
    import_module("queries").main(["--quick", "--site=intel", f"--output={tmp_path}"])
    assert [path.name for path in tmp_path.iterdir()] == ["queries_intel.json"]


def test_stages_are_timed_and_put_back():
    measuring = import_module("measuring")

    class Work:
        @staticmethod
        def add(a, b):
            return a + b

    before = Work.add
    with measuring.stage_seconds({"adding": (Work, "add")}) as seconds:
        assert Work.add(1, b=2) == 3
    assert seconds["adding"] > 0 and Work.add is before


def test_titles_of_streets_lie_under_no_strip_of_the_row_above():
    pytest.importorskip("embreex")
    streets = import_module("simulated_streets_against_real")
    points = np.random.default_rng(0).uniform([-20, -20, -1.7], [20, 20, 3], (500, 3))
    figure = streets.drawn([streets.View(f"street {number}", "hdl64", points, points[:, 2] + 1.7) for number in range(4)])
    figure.draw_without_rendering()
    titles = [axes.title.get_window_extent() for axes in figure.axes if axes.get_title()]
    strips = [axes.get_window_extent() for axes in figure.axes if not axes.get_title()]
    assert len(titles) == len(strips) == 8 and not any(title.overlaps(strip) for title in titles for strip in strips)
    assert [axes.get_ylabel() for axes in figure.axes].count("m") == 4
    streets.plt.close(figure)
