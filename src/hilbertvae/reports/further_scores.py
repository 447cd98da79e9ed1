"""What METHOD 7 wants beside precision and recall, as Markdown: how much is called anything, the same for free, and how good the
probabilities are."""

from __future__ import annotations

from hilbertvae.reports.score_table import NOTHING, READINGS, REGIONS, markdown, mean_and_spread, percent
from hilbertvae.scoring.result import Result

SHARES = {
    "recall": "recall", "known": "not unknown", "free_precision": "free prec.", "free_recall": "free recall", "iou": "IoU",
}  # fmt: skip
LOSSES = {"nll": "NLL", "brier": "Brier", "ece": "ECE"}


def further_scores(result: Result) -> str:
    """A table for each reading and region in which anything was asked, with the base rate and the number of queries under it.

    Empty where nothing was scored."""
    parts = []
    for reading in READINGS:
        for region in REGIONS:
            rows = [row for name in result.scores if (row := _row(result, name, reading, region))]
            if rows:
                header = [f"{region}, {reading}", *SHARES.values(), *LOSSES.values()]
                parts.append(f"{markdown(header, rows)}\n\n{_asked(result, reading, region)}")
    return "\n\n".join(parts)


def _row(result: Result, name: str, reading: str, region: str) -> list[str] | None:
    if not result.values(name, reading, region, "nll"):
        return None
    shares = [percent(result.values(name, reading, region, metric)) for metric in SHARES]
    return [name, *shares, *(_loss(result.values(name, reading, region, metric)) for metric in LOSSES)]


def _loss(values: list[float]) -> str:
    return f"{mean_and_spread(values)[0]:.3f}" if values else NOTHING


def _asked(result: Result, reading: str, region: str) -> str:
    """The same for every mapper, so in a line: how many were asked, how many of them are occupied, and the NLL of knowing only that."""
    first = next(name for name in result.scores if result.values(name, reading, region, "nll"))
    base, count, nll = (result.values(first, reading, region, metric) for metric in ("base_rate", "count", "base_rate_nll"))
    constant = f", which alone has NLL {_loss(nll)}" if nll else ""  # results of older versions don't say
    return f"Of {mean_and_spread(count)[0]:,.0f} {reading} a gap seed {percent(base)} % are occupied{constant}."
