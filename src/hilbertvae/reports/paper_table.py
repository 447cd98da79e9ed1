"""The paper's rows beside ours (section IV; METHOD 7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hilbertvae.reports.score_table import NOTHING, heading, markdown, mean_and_spread, percent, told_given
from hilbertvae.scoring.result import Result, asked


class PaperRow(NamedTuple):
    """Precision and recall in percent, as printed; `ours` names the mappers here that stand for it."""

    name: str
    observed: tuple[float, float]
    gaps: tuple[float, float]
    ours: tuple[str, ...]


PAPER = {
    2: (
        PaperRow("GPOM", (90.60, 80.83), (34.61, 29.94), ("gpom",)),
        PaperRow("LARD-HM", (80.44, 99.70), (53.58, 51.71), ("lard-hm",)),
        PaperRow("CAE-HM", (77.82, 74.89), (45.22, 42.45), ("cae-hm-paper", "cae-hm-points")),
        PaperRow("CVAE-HM", (96.64, 94.75), (90.86, 86.29), ("cvae-hm-paper", "cvae-hm-points")),
    ),
    3: (
        PaperRow("OctoMap", (95.59, 94.99), (16.85, 21.94), ("octomap",)),
        PaperRow("LARD-HM", (86.08, 96.58), (40.20, 38.62), ("lard-hm",)),
        PaperRow("CAE-HM", (61.92, 64.53), (36.20, 34.26), ("cae-hm-paper", "cae-hm-points")),
        PaperRow("CVAE-HM", (92.91, 89.68), (86.02, 81.27), ("cvae-hm-paper", "cvae-hm-points")),
    ),
}
NOTE = (
    "Scored on points: precision / recall in percent, mean±sd over gap seeds; differences in points of percent. The paper's observed rows "
    "are on points that were fitted: compare them with ours on fitted points; held-out beams are the harder question. The paper says "
    "neither on which site it scored nor how many gaps it cut where, so a difference is of data as well as of method."
)
MOVED_NOTE = "At the paper's: with another cut than 0.6, our precision at the paper's recall, and our recall at the paper's precision."
OCTOMAP_NOTE = (
    "OctoMap is fed labelled points, as every mapper is, and calls nothing in a gap: no point of one is shown. The paper's has answers "
    "there; fed rays, which cross gaps, OctoMap calls nothing in them occupied either (docs/decisions.md)."
)


def paper_table(result: Result) -> str:
    """Markdown: paper | ours | difference, for what this result's dimension has in the paper; a mapper that was not run has empty cells.

    Empty where mappers were given a map, and not scans as in the paper.
    """
    if told_given(result.protocol):
        return ""
    columns = (
        "observed, paper",
        "fitted, ours",
        "held out, ours",
        "gaps, paper",
        "gaps, ours",
        "difference in gaps",
        "ours at the paper's",
    )
    rows = []
    for row in PAPER[result.dimension]:
        ours = [name for name in row.ours if name in result.scores] or [NOTHING]
        for name in ours:
            regions = result.regions(name, "points")
            both = [_pair(regions.get(region, {})) for region in ("fitted", "observed", "gaps")]
            difference = _difference(regions.get("gaps", {}), row.gaps)
            moved = _at_the_paper_s(result.told_curves(name, "points"), row.gaps)
            rows.append([row.name, name, _printed(row.observed), both[0], both[1], _printed(row.gaps), both[2], difference, moved])
    note = f"{NOTE} {MOVED_NOTE} {OCTOMAP_NOTE}" if result.dimension == 3 else f"{NOTE} {MOVED_NOTE}"
    return f"### {heading(result)}, beside the paper\n\n{markdown(['paper', 'ours', *columns], rows)}\n\n{note}\n"


def _printed(pair: tuple[float, float]) -> str:
    return f"{pair[0]:.2f} / {pair[1]:.2f}"


def _pair(metrics: dict[str, list[float]]) -> str:
    return " / ".join(percent(asked(metrics, metric)) for metric in ("precision", "recall")) if metrics else NOTHING


def _at_the_paper_s(curves: list[list[float]], printed: tuple[float, float]) -> str:
    """Precision at the printed recall and recall at the printed precision, of each gap seed's curve (precision at recalls 0, 0.01 ...)."""
    if not curves:
        return NOTHING
    precision, recall = (value / 100 for value in printed)
    found = np.asarray(curves)
    last = found.shape[1] - 1
    at_recall = found[:, int(np.ceil(recall * last))]
    reached = found >= precision  # falls along a curve, which has the best precision at a recall or more
    at_precision = np.maximum(reached.sum(axis=1) - 1, 0) / last
    return f"{percent(at_recall.tolist())} / {percent(at_precision.tolist())}"


def _difference(metrics: dict[str, list[float]], printed: tuple[float, float]) -> str:
    if not metrics:
        return NOTHING
    found = [(asked(metrics, metric), value) for metric, value in zip(("precision", "recall"), printed, strict=True)]
    return " / ".join(f"{100 * mean_and_spread(ours)[0] - value:+.1f}" if ours else NOTHING for ours, value in found)
