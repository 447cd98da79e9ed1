"""TensorBoard's hparams tab: one row per run, its settings beside its headline scores."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from hilbertvae.dotted_keys import leaves
from hilbertvae.reports.mapper_names import champions, is_rival
from hilbertvae.scoring.result import Result

HEADLINES = {
    "headline/gaps_points_f1": ("points", "gaps", "f1"),
    "headline/gaps_points_auc": ("points", "gaps", "auc"),
    "headline/gaps_voxels_best_f1": ("voxels", "gaps", "best_f1"),
    "headline/gaps_voxels_auc": ("voxels", "gaps", "auc"),
    "headline/observed_points_f1": ("points", "observed", "f1"),
}
"""Tag by reading, region and metric, of the run's own map calibrated for that reading."""
SECTIONS = ("network", "grid", "likelihood", "trainer")
"""Few, since the tab shows the first ones of all alphabetically; the whole configuration stands in the text tab."""


def headlines(result: Result) -> dict[str, float]:
    """The headline scores of the run's own map, means over gap seeds; of a run without a network, of the first that competes.
    A map that failed has none, and none stands in for it."""
    found = {}
    for tag, (reading, region, metric) in HEADLINES.items():
        for name in champions(result.mappers(), reading)[:1] or filter(is_rival, result.scores):
            values = result.values(name, reading, region, metric)
            if values:
                found[tag] = float(np.mean(values))
                break
    return found


def write_hparams(writer: SummaryWriter, config: dict, result: Result | None = None) -> None:
    """The run's row. At the start of a run, without a result, all headlines are named, since a column that comes later stays empty."""
    found = headlines(result) if result else {}
    experiment, start, end = hparams(dict(_flat(config)), dict.fromkeys(HEADLINES, 0.0))
    for summary in (experiment, start, *([end] if result else [])):
        writer.file_writer.add_summary(summary)
    for tag, value in found.items():
        writer.add_scalar(tag, value, 0)
    writer.flush()


def _flat(config: dict) -> Iterator[tuple[str, str | float | bool]]:
    """Settings that may tell runs apart, by dotted name."""
    for key in ("case", "seed"):
        if key in config:
            yield key, config[key]
    for section in SECTIONS:
        for key, value in leaves(config.get(section) or {}, section):
            yield key, value if isinstance(value, (str, bool, int, float)) else str(value)
