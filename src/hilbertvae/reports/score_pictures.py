"""Scores as pictures: precision over recall of every mapper, and how far probabilities can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count, cycle

import numpy as np
from matplotlib.figure import Figure

from hilbertvae.drawing.canvas import HALO, new_figure, title_of
from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.reports.mapper_names import is_network
from hilbertvae.scoring.metrics import CALIBRATION_BINS, calibration_error
from hilbertvae.scoring.result import Result

MARKERS = "osD^vPX"
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (5, 1.5, 1.2, 1.5)))
FEWEST = 10
"""Points that a bin of the reliability diagram needs: the share of fewer says nothing."""


def line_styles(names) -> dict[str, dict]:
    """Keywords of `Axes.plot` by mapper: those with a network thick and in one colour, the others thin, each in its own."""
    ours, others = count(), count()
    styles = {}
    for name in names:
        if is_network(name):
            styles[name] = {"color": OURS, "linestyle": DASHES[next(ours) % len(DASHES)], "linewidth": 2.2, "zorder": 4}
        else:
            turn = next(others)
            dash = DASHES[turn // len(OTHERS) % len(DASHES)]
            styles[name] = {"color": OTHERS[turn % len(OTHERS)], "linestyle": dash, "linewidth": 1.3, "zorder": 3}
    return styles


def precision_recall_picture(result: Result) -> Figure:
    """Precision over recall inside gaps, a panel per reading: mean over gap seeds, bands from the lowest seed to the highest.

    A marker is where the protocol's cut (p > 0.6) puts the mapper; grey lines join points of equal F1. Curves are `Result.told_curves`.
    """
    readings = [reading for reading in ("points", "voxels") if any(reading in curves for curves in result.curves.values())]
    if not readings:
        raise ValueError("result.curves: expected the curves of at least one mapper, got none")
    figure = new_figure(5.0 * len(readings) + 1.6, 4.9)
    panels = figure.subplots(1, len(readings), squeeze=False)[0]
    styles = {
        name: {**style, "marker": marker} for (name, style), marker in zip(line_styles(result.curves).items(), cycle(MARKERS), strict=False)
    }
    handles = {}
    for axes, reading in zip(panels, readings, strict=True):
        _f1_lines(axes)
        for name, style in styles.items():
            seeds = np.array(result.told_curves(name, reading), dtype=float)
            if not len(seeds):
                continue
            recall = np.linspace(0, 1, seeds.shape[1])
            # The marker is on no point of the curve; it is there for the legend.
            (handles[name],) = axes.plot(recall, seeds.mean(axis=0), markevery=[], markersize=5, **style)
            if len(seeds) > 1:
                axes.fill_between(recall, seeds.min(axis=0), seeds.max(axis=0), color=style["color"], alpha=0.12, linewidth=0)
            recalls, precisions = (result.values(name, reading, "gaps", metric) for metric in ("recall", "precision"))
            if recalls and np.mean(recalls) > 0:
                at_cut = np.mean(recalls), np.mean(precisions)
                axes.plot(*at_cut, style["marker"], color=style["color"], markersize=6, markeredgecolor="white", zorder=5, clip_on=False)
        title_of(axes, f"{result.site}, gaps of {result.gap_diameter_m:g} m, {reading}", pad=None)
        axes.set(xlim=(0, 1), ylim=(0, 1.005), xlabel="recall", ylabel="precision", aspect="equal")
        axes.spines[["top", "right"]].set_visible(False)
    figure.legend(handles.values(), handles.keys(), loc="outside right center", frameon=False, fontsize=9, handlelength=2.6)
    return figure


def _f1_lines(axes) -> None:
    for f1 in (0.2, 0.4, 0.6, 0.8):
        recall = np.linspace(f1 / (2 - f1), 1, 200)
        axes.plot(recall, f1 * recall / (2 * recall - f1), color="#d8d8d8", linewidth=0.8, zorder=1)
        axes.annotate(
            f"F1 {f1:g}",
            (1, f1 / (2 - f1)),
            (-2, 2),
            textcoords="offset points",
            fontsize=7,
            color="#9a9a9a",
            ha="right",
            path_effects=HALO,
        )


def reliability_picture(answers: Mapping[str, tuple[np.ndarray, np.ndarray]], title: str = "") -> Figure:
    """Share of occupied points over the probability that was given, in equal bins, with Wilson's 95 % intervals; below, how many answers.

    answers: by mapper, labels (Q,) bool and p(occupied) (Q,). On the diagonal a probability means what it says.
    """
    figure = new_figure(5.2, 5.8 + 0.2 * len(answers))
    axes, counts = figure.subplots(2, 1, sharex=True, height_ratios=[4, 1])
    axes.plot([0, 1], [0, 1], color="#9a9a9a", linewidth=1, zorder=1)
    for (name, (occupied, probability)), style in zip(answers.items(), line_styles(answers).values(), strict=True):
        mean, share, count = reliability(occupied, probability)
        kept = count >= FEWEST
        low, high = wilson(share, np.maximum(count, 1))
        spread = np.maximum([share - low, high - share], 0)[:, kept]  # rounding may leave -1e-17
        label = f"{name}  (ECE {calibration_error(occupied, probability):.3f})"
        # All of it lies inside; a marker at 0 or 1 would be cut in half.
        axes.errorbar(mean[kept], share[kept], spread, marker="o", markersize=4, elinewidth=0.8, label=label, clip_on=False, **style)
        counts.stairs(count, np.linspace(0, 1, len(count) + 1), color=style["color"], linestyle=style["linestyle"])
    axes.set(xlim=(0, 1), ylim=(0, 1), ylabel="share that is occupied")
    title_of(axes, title, pad=None)
    figure.legend(*axes.get_legend_handles_labels(), frameon=False, fontsize=9, loc="outside lower center")
    counts.set(yscale="log", xlabel="p(occupied)", ylabel="answers")
    for panel in (axes, counts):
        panel.spines[["top", "right"]].set_visible(False)
    return figure


def wilson(share: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends of Wilson's (1927) 95 % interval of shares of so many answers, which has a width at shares of 0 and 1, too."""
    z = 1.96
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return middle - half, middle + half


def reliability(occupied: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(mean probability, share of occupied, number of answers), each (`CALIBRATION_BINS`,); the first two are 0 where there are none."""
    bin_of = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    count = np.bincount(bin_of, minlength=CALIBRATION_BINS)
    mean, share = (np.bincount(bin_of, values, CALIBRATION_BINS) / np.maximum(count, 1) for values in (probability, occupied))
    return mean, share, count
