"""A `Result` in TensorBoard: scores as scalars, pictures, table and settings. Tables are made from `result.json`, never from here."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from torch.utils.tensorboard import SummaryWriter

from hilbertvae.reports.score_table import markdown_scores
from hilbertvae.scoring.result import Result, asked

SCORED = ".scores"
"""What the name of a scoring's file ends with; Lightning's, of a training in the same folder, end otherwise."""
FLUSH_S = 10
"""Seconds after which events are in their file. A stop that comes while one is handed to the thread that writes may keep that thread
asleep for as long, and the run alive (a lost wake-up of Python's queues); TensorBoard's own 120 are longer than `kill` is waited for."""


def scores_writer(folder: str | Path, anew: bool) -> SummaryWriter:
    """A writer of a scoring's own file. anew: what earlier scorings wrote into `folder` goes, as it would be shown as this one's: their
    points beside these, and mappers and pictures that there are no more. A training's curves stay."""
    if anew:
        for file in Path(folder).glob(f"events*{SCORED}"):
            file.unlink()
    return SummaryWriter(str(folder), filename_suffix=SCORED, flush_secs=FLUSH_S)


def score_scalars(result: Result) -> dict[str, float]:
    """`score/<site>/<mapper>/<reading>/<region>/<metric>` by the mean over gap seeds that have something in the region."""
    return {
        f"score/{site_tag(result.site)}/{mapper}/{reading}/{region}/{metric}": float(np.mean(values))
        for mapper, readings in result.scores.items()
        for reading, regions in readings.items()
        for region, metrics in regions.items()
        for metric in metrics
        if (values := asked(metrics, metric))
    }


def site_tag(site: str) -> str:
    """A site's name in tags, of scores, pictures and surfaces alike: a run may have several test sites."""
    return site.replace(":", "_")


def write_tensorboard(writer, result: Result, images: Mapping[str, np.ndarray] | None = None, config: dict | None = None) -> None:
    """Write everything to `writer`, a `torch.utils.tensorboard.SummaryWriter` or what acts like one.

    images: by tag, such as `site/map`, (height, width, 3) uint8. config: plain containers, shown as text.
    """
    for tag, value in score_scalars(result).items():
        writer.add_scalar(tag, value, 0)
    for tag, image in (images or {}).items():
        writer.add_image(tag, image, 0, dataformats="HWC")
    writer.add_text(f"{site_tag(result.site)}/scores", markdown_scores(result), 0)
    if config is not None:
        # Four spaces make a Markdown code block, whatever the text contains.
        writer.add_text("config", "\n".join("    " + line for line in json.dumps(config, indent=2, default=str).splitlines()), 0)
    writer.flush()
