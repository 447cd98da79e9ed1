import io
import re

import numpy as np
import pytest
from reports_toys import result
from rich.console import Console

from hilbertvae.reports.paper_table import PAPER, paper_table
from hilbertvae.reports.score_table import heading, markdown_scores, percent, print_scores, rows_of, told_given
from hilbertvae.scoring.metrics import score
from hilbertvae.scoring.protocol_settings import GIVEN


def printed(found, width):
    console = Console(file=io.StringIO(), width=width)
    print_scores(found, console)
    return console.file.getvalue()


def test_cells_are_the_result_s_numbers():
    found = result()
    *rows, ceiling = rows_of(found, "voxels")
    assert [row[0] for row in rows] == ["cvae-hm", "nearest"]
    columns = [(region, metric) for region in ("observed", "gaps") for metric in ("precision", "recall", "f1", "auc")]
    for row in rows:
        for cell, (region, metric) in zip(row[1:], columns, strict=True):
            values = 100 * np.array(found.scores[row[0]]["voxels"][region][metric])
            mean, spread = map(float, cell.strip("*").split("±"))
            assert (mean, spread) == pytest.approx((values.mean(), values.std(ddof=1)), abs=0.051)
    assert ceiling == ["ceiling", "100.0", "99.0", *["-"] * 6]


def test_a_site_s_name_is_printed_as_it_is():
    found = result()
    found.site = "office[new].log"
    assert printed(found, 140).count("office[new].log (2D), gaps of 2.5 m") == 2


def test_the_best_f1_and_auc_are_bold_and_nothing_else():
    found = result()
    better = max(found.scores, key=lambda name: np.mean(found.scores[name]["points"]["gaps"]["f1"]))
    rows = {row[0]: row for row in rows_of(found, "points")}
    assert rows[better][7].startswith("**")
    assert sum(cell.startswith("**") for row in rows.values() for cell in row) == 4


def test_who_is_told_where_gaps_are_is_never_the_best():
    found = result(mappers=("cvae-hm", "nearest", "gap-centre"))
    for values in found.scores["gap-centre"]["points"]["gaps"].values():
        values[:] = [1.0] * len(values)
    rows = {row[0]: row for row in rows_of(found, "points")}
    assert rows["gap-centre"][7] == "100.0±0.0" and any(rows[name][7].startswith("**") for name in ("cvae-hm", "nearest"))


@pytest.mark.parametrize("width", [80, 120])
def test_console_shows_every_cell_whole(width):
    found = result(mappers=("cvae-hm-points", "nearest"))
    found.scores["nearest"]["points"]["gaps"]["recall"] = [1.0, 1.0, 1.0]
    text = printed(found, width)
    assert max(map(len, text.splitlines())) <= width and "…" not in text
    for reading in ("points", "voxels"):
        for row in rows_of(found, reading):
            for cell in row:
                assert cell.strip("*") in text
    lines = [line.split()[0] for line in text.split("scored on voxels")[0].splitlines() if line.strip()]
    assert "ceiling" in lines


def test_one_seed_has_no_spread_and_a_missing_region_no_number():
    assert percent([0.8512]) == "85.1"
    assert percent([0.5, 0.7]) == "60.0±14.1"
    found = result(seeds=(7,))
    del found.scores["nearest"]["points"]["observed"]
    text = printed(found, 120)
    assert "±" not in text.replace("mean±sd", "") and "1 gap seed," in text
    assert rows_of(found, "points")[1][1:5] == ["-"] * 4


def test_failed_mappers_are_listed_with_their_message():
    found = result()
    found.failed["gpom"] = "InputError: [too slow]"
    assert "gpom failed: InputError: [too slow]" in printed(found, 120)
    assert [row[0] for row in rows_of(found, "points")] == ["cvae-hm", "nearest", "gpom", "ceiling"]
    assert "gpom failed: InputError: [too slow]" in markdown_scores(found)


def test_markdown_has_the_same_numbers_and_the_best_f1():
    found = result()
    lines = [line for line in markdown_scores(found).splitlines() if line.startswith("| nearest")]
    assert len(lines) == 2
    cells = [cell.strip(" *") for cell in lines[0].strip("|").split("|")]
    expected = [cell.strip("*") for cell in rows_of(found, "points")[1]]
    assert cells[:5] == expected[:5] and cells[6:10] == expected[5:]
    assert cells[10] == percent(found.scores["nearest"]["points"]["gaps"]["best_f1"])


def test_the_paper_s_rows_stand_beside_ours():
    found = result(mappers=("cvae-hm-paper", "cvae-hm-points", "lard-hm"))
    found.scores["cvae-hm-paper"]["points"]["gaps"].update(precision=[0.8, 0.9, 1.0], recall=[0.5, 0.5, 0.5])
    text = paper_table(found)
    row = next(line for line in text.splitlines() if "cvae-hm-paper" in line)
    assert "90.86 / 86.29" in row and "90.0±10.0 / 50.0±0.0" in row and "-0.9 / -36.3" in row
    assert re.search(r"\| GPOM \| - \|", text)
    assert len([line for line in text.splitlines() if line.startswith("| CVAE-HM")]) == 2
    assert "16.85 / 21.94" in paper_table(result(dimension=3))


def test_gaps_that_hide_nothing_occupied_have_no_difference_from_the_paper():
    """Of a small site with one gap seed a single ball may be cut, in which no wall is."""
    found = result(mappers=("gpom", "lard-hm"), seeds=(0,))
    for name, count in (("gpom", 40), ("lard-hm", 0)):
        free = score(np.zeros(count, bool), np.full(count, 0.2))
        found.scores[name]["points"]["gaps"] = {metric: [value] for metric, value in free.items()}
    rows = [[cell.strip() for cell in line.split("|")] for line in paper_table(found).splitlines() if line.startswith("|")]
    difference = {row[2]: row[8] for row in rows}
    assert difference["gpom"] == "-34.6 / -" and difference["lard-hm"] == "- / -"


def test_where_our_curve_passes_the_paper_s_point():
    """Of 90.86 / 86.29: two curves that fall evenly from 1 to 0.5 and from 1 to 0, and one that never is so precise."""
    found = result(mappers=("cvae-hm-points",))
    recall = np.linspace(0, 1, 101)
    found.curves["cvae-hm-points"] = {"points": [(1 - 0.5 * recall).tolist(), (1 - recall).tolist(), [0.9] * 101]}
    at_recall, at_precision = [1 - 0.5 * 0.87, 1 - 0.87, 0.9], [0.18, 0.09, 0.0]
    row = next(line for line in paper_table(found).splitlines() if "cvae-hm-points" in line and "90.86" in line)
    assert row.endswith(f"| {percent(at_recall)} / {percent(at_precision)} |")
    found.curves["cvae-hm-points"]["points"].append([0.0] * 101)  # of a gap seed in which nothing is occupied
    assert row in paper_table(found).splitlines()
    found.curves.clear()
    assert next(line for line in paper_table(found).splitlines() if "90.86" in line).endswith("| - |")
    assert set(PAPER) == {2, 3}


def test_what_mappers_were_given_is_told_where_it_was_not_scans():
    assert told_given({}) == told_given({"given": "scans"}) == ""  # results from before maps could be given say nothing of it
    of_maps = {told_given({"given": given}) for given in GIVEN if given != "scans"}
    assert len(of_maps) == len(GIVEN) - 1 and all(words.startswith(", given a map") for words in of_maps)


@pytest.mark.parametrize(
    ("protocol", "words"),
    [({}, "2.5 m, "), ({"rim": False}, "2.5 m without a rim, "), ({"centred": True}, "2.5 m centred on returns, ")],
)
def test_gaps_that_are_cut_otherwise_are_told_beside_their_size(protocol, words):
    found = result()
    found.protocol |= protocol
    assert f", gaps of {words}" in heading(found) and f", gaps of {words}" in paper_table(found)


def test_the_paper_s_rows_stand_beside_those_of_scans_alone():
    found = result()
    found.protocol |= {"given": "map"}
    assert paper_table(found) == "" and ", given a map" in heading(found)
