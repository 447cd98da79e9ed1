import numpy as np
import pytest
from reports_toys import result

from hilbertvae.reports.further_scores import further_scores
from hilbertvae.reports.report import scores_text
from hilbertvae.reports.score_table import percent


def rows(text):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def test_every_mapper_has_all_that_stands_beside_precision():
    found = result()
    text = further_scores(found)
    tables = [row[0] for row in rows(text) if "," in row[0]]
    assert tables == ["observed, points", "gaps, points", "observed, voxels", "gaps, voxels"]
    header, _, ours, theirs = rows(text)[-4:]
    assert header[1:] == ["recall", "not unknown", "free prec.", "free recall", "IoU", "NLL", "Brier", "ECE"]
    for row, name in ((ours, "cvae-hm"), (theirs, "nearest")):
        scored = found.scores[name]["voxels"]["gaps"]
        shares = [percent(scored[metric]) for metric in ("recall", "known", "free_precision", "free_recall", "iou")]
        losses = [float(np.mean(scored[metric])) for metric in ("nll", "brier", "ece")]
        assert row[:6] == [name, *shares] and list(map(float, row[6:])) == pytest.approx(losses, abs=5.1e-4)
    base = found.scores["cvae-hm"]["voxels"]["gaps"]
    constant = f"which alone has NLL {np.mean(base['base_rate_nll']):.3f}."
    assert text.splitlines()[-1].endswith(f" {percent(base['base_rate'])} % are occupied, {constant}")
    assert scores_text(found).endswith(text + "\n")


def test_what_was_not_asked_has_no_row():
    found = result()
    del found.scores["nearest"]["points"]["gaps"]
    for name in found.scores:
        del found.scores[name]["voxels"]
    text = further_scores(found)
    assert [row[0] for row in rows(text)] == ["observed, points", "---", "cvae-hm", "nearest", "gaps, points", "---", "cvae-hm"]
    assert further_scores(result(mappers=())) == ""


def test_results_of_older_versions_don_t_say_the_nll_of_the_base_rate():
    found = result()
    for name in found.scores:
        del found.scores[name]["points"]["gaps"]["base_rate_nll"]
    assert "% are occupied.\n" in further_scores(found)
