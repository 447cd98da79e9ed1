"""What the main table leaves out, as Markdown: methods compared pairwise per gap seed, real occlusion by distance (METHOD 7), and
how well errors are known."""

from __future__ import annotations

from hilbertvae.reports.mapper_names import CHAMPIONS, is_rival
from hilbertvae.reports.score_table import NOTHING, markdown, percent
from hilbertvae.scoring.cases import OCCLUSION_STEP
from hilbertvae.scoring.result import ERROR_METRICS, Result, asked

HEADLINES = (("points", "f1", "F1 at the cut"), ("points", "auc", "AUC"), ("voxels", "best_f1", "best F1"), ("voxels", "auc", "AUC"))
"""Reading, metric and name of what methods are compared by where nothing was shown."""
COMPARED = ("gaps", "gaps-above-ground", "occluded-sparse", "occluded-half")
"""Regions with a table of their own, where they were scored."""


def pairwise_table(result: Result, region: str = "gaps") -> str:
    """For each baseline, in how many gap seeds the network's map is better in the region, and by how much on average, in points.

    Empty where nothing was scored in the region.
    """
    choices = _choices(result).get(region)
    header = [f"in {region}{f' ({choices} of scans)' if choices else ''}, against"]
    columns = []
    for reading, metric, title in HEADLINES:
        champion = next((name for name in CHAMPIONS[reading] if region in result.regions(name, reading)), None)
        if champion is not None:
            header.append(f"`{champion}`, {reading}, {title}")
            columns.append((champion, reading, metric))
    rows = []
    for rival in filter(is_rival, result.scores):
        row = [rival]
        for champion, reading, metric in columns:
            ours, theirs = (result.values(name, reading, region, metric) for name in (champion, rival))
            differences = [100 * (a - b) for a, b in zip(ours, theirs, strict=True)] if theirs else []
            better = sum(d > 0 for d in differences)
            row.append(f"{better} of {len(differences)}, {sum(differences) / len(differences):+.1f}" if differences else NOTHING)
        if any(cell != NOTHING for cell in row[1:]):  # one that was told where gaps are is not asked in all regions
            rows.append(row)
    return markdown(header, rows) if rows and columns else ""


def occlusion_table(result: Result) -> str:
    """AUC, and NLL beside that of a constant base rate, in what only the left-out scans saw, by distance from the nearest point kept.

    Regions in which no gap seed has a voxel are left out.
    """
    every = [readings["voxels"] for readings in result.scores.values() if "voxels" in readings]
    regions = sorted({region for found in every for region, metrics in found.items() if "occluded" in region and any(metrics["count"])})
    if not regions:
        return ""
    rows = []
    for name, readings in result.scores.items():
        found = readings["voxels"]
        if regions[0] in found:
            seen = ((asked(found[region], metric) for metric in ("auc", "nll")) for region in regions)
            rows.append([name, *(f"{percent(auc)}; {_mean(nll):.3f}" for auc, nll in seen)])
    first = next(readings["voxels"] for readings in result.scores.values() if regions[0] in readings["voxels"])
    rows.append(["constant base rate", *(f"50.0; {_mean(asked(first[region], 'base_rate_nll')):.3f}" for region in regions)])
    sparse, half = _choices(result).values()
    seeds = len(result.gap_seeds)
    said = f"The {seeds} gap seed{'s are' if seeds > 1 else ' is'} {sparse} of scans for occluded-sparse, and {half} for occluded-half."
    return markdown(["AUC; NLL (voxels)", *regions], rows) + "\n\n" + said


def _choices(result: Result) -> dict[str, str]:
    """By region how many cases its gap seeds are: scores of the same scans are no further evidence."""
    several = len({seed % OCCLUSION_STEP[result.dimension] for seed in result.gap_seeds})
    return {"occluded-sparse": f"{several} different choices" if several > 1 else "one choice", "occluded-half": "one choice"}


def error_table(result: Result) -> str:
    """How well maps know where in gaps they are wrong: AUC of errors by the spread of what their grids say, and by 1 - |2p - 1|.

    Empty where no mapper says its spread.
    """
    rows = []
    for name in result.scores:
        spread, doubt = (result.values(name, "voxels", "gaps", metric) for metric in ERROR_METRICS)
        if spread:
            better = sum(a > b for a, b in zip(spread, doubt, strict=True))
            rows.append([name, percent(spread), percent(doubt), f"{better} of {len(spread)}"])
    header = ["AUC of errors in gaps (voxels)", "by the grids' spread", "by 1 - |2p - 1|", "spread is better in"]
    return markdown(header, rows) if rows else ""


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
