"""Mean and spread of what several runs found: over gap seeds in a run, and over training seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from hilbertvae.reports.score_table import mean_and_spread


class Spread(NamedTuple):
    """A mean with the standard deviation of a sample (n - 1); `n` values are what the deviation is of."""

    mean: float
    sd: float | None
    n: int


def spread(values: Sequence[float]) -> Spread | None:
    """Of some numbers; None where there are none."""
    return Spread(*mean_and_spread(list(values)), len(values)) if len(values) else None


def over_seeds(runs: Sequence[Sequence[float]]) -> Spread | None:
    """Of one list per training seed, each with one number per gap seed; None without any.

    The mean is over gap seeds in each run and then over runs. The deviation is that of the runs' means, so that it holds what another
    training would change; with a single run it can only be that of the gap seeds.
    """
    runs = [run for run in runs if len(run)]
    if len(runs) == 1:
        return spread(runs[0])
    return spread([mean_and_spread(run)[0] for run in runs])


Paired = dict[int, list[float]]
"""By training seed, one number per gap seed."""


def differences(ours: Mapping[int, Sequence[float]], theirs: Mapping[int, Sequence[float]], untrained: bool = False) -> Paired:
    """ours - theirs, gap seed by gap seed, by training seed: the same balls are cut for both, so that what they share cancels.

    Runs are paired by training seed. With `untrained`, whichever side knows one seed only stands against all of the other's: nothing
    in it depends on one.
    """
    if untrained and len(theirs) == 1:
        (one,) = theirs.values()
        theirs = dict.fromkeys(ours, one)
    elif untrained and len(ours) == 1:
        (one,) = ours.values()
        ours = dict.fromkeys(theirs, one)
    return {seed: [a - b for a, b in zip(ours[seed], theirs[seed], strict=True)] for seed in sorted(set(ours) & set(theirs))}


def share_of(found: Mapping[int, Sequence[float]], holds: Callable[[float], bool]) -> str | None:
    """In how many of all numbers something holds: `4 of 5`; None where there are none."""
    values = [value for run in found.values() for value in run]
    return f"{sum(map(holds, values))} of {len(values)}" if values else None
