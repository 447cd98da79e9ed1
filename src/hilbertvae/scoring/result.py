"""What an evaluation found: the contract of `result.json` (METHOD 7)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

SCHEMA_VERSION = 1
Scores = dict[str, dict[str, dict[str, dict[str, list[float]]]]]


@dataclass
class Result:
    """Scores of mappers on one site. scores[mapper][reading][region][metric] is a list with one float per gap seed.

    ceiling[reading] holds the `precision` and `recall` of the best vote at the map's own cell size. seconds[mapper][stage],
    maps[mapper] (`bytes` and `clusters` of the gapped site's map, one per gap seed) and gaps (the balls of each seed) are there for
    whoever wants to repeat, weigh or time it.
    """

    site: str
    dimension: int
    gap_diameter_m: float
    gap_seeds: list[int]
    ceiling: dict[str, dict[str, float]]
    scores: Scores = field(default_factory=dict)
    seconds: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    maps: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    gaps: list[dict] = field(default_factory=list)
    curves: dict = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    protocol: dict = field(default_factory=dict)

    def mappers(self) -> list[str]:
        """Names of all that were to be scored, those that failed after the others."""
        return [*self.scores, *self.failed]

    def regions(self, mapper: str, reading: str) -> dict[str, dict[str, list[float]]]:
        """Metrics by region; none where it was not scored."""
        return self.scores.get(mapper, {}).get(reading, {})

    def values(self, mapper: str, reading: str, region: str, metric: str) -> list[float]:
        """One number per gap seed that has something in the region; none where it was not scored."""
        return asked(self.regions(mapper, reading).get(region, {}), metric)

    def told_curves(self, mapper: str, reading: str) -> list[list[float]]:
        """Of `curves` those of gap seeds in which something is occupied; of others there is no precision at any recall, and they are 0."""
        return [curve for curve in self.curves.get(mapper, {}).get(reading, []) if any(curve)]

    def add(self, other: Result) -> Result:
        """This result with the mappers of another evaluation of the same site under the same protocol; a `ValueError` for what can't stand
        side by side, and for two mappers of one name."""
        for name in ("site", "dimension", "gap_seeds", "protocol", "ceiling"):
            if getattr(self, name) != getattr(other, name):
                raise ValueError(f"results differ in {name}: {getattr(self, name)!r} and {getattr(other, name)!r}")
        ours, theirs = ({gaps["seed"]: gaps for gaps in result.gaps} for result in (self, other))
        if any(ours[seed] != theirs[seed] for seed in ours.keys() & theirs.keys()):
            raise ValueError(f"results differ in gaps: those of {self.site} were cut elsewhere; are these two sites of one name?")
        if both := {*self.mappers()} & {*other.mappers()}:
            raise ValueError(f"results have both {', '.join(sorted(both))}; give `evaluate` a `name` for each")
        for name in ("scores", "seconds", "maps", "curves", "failed"):
            getattr(self, name).update(getattr(other, name))
        return self

    def followed_by(self, other: Result) -> Result:
        """This result with the gap seeds of another evaluation of the same mappers on the same site after its own.

        A mapper that failed with any seed has no scores.
        """
        joined = {name: _chained(getattr(self, name), getattr(other, name)) for name in ("scores", "seconds", "maps", "curves")}
        failed = {**other.failed, **self.failed}
        for by_mapper in joined.values():
            for name in failed:
                by_mapper.pop(name, None)
        seeds = self.gap_seeds + other.gap_seeds
        protocol = {**self.protocol, "gap_seeds": seeds}
        return replace(self, gap_seeds=seeds, gaps=self.gaps + other.gaps, failed=failed, protocol=protocol, **joined)

    def plain(self, **about) -> dict:
        """As JSON takes it; `about` adds what made it (config, commit, packages, host, times)."""
        return {
            "schema_version": SCHEMA_VERSION,
            "status": "failed" if self.failed else "ok",
            "site": self.site,
            "dimension": self.dimension,
            "gap_diameter_m": self.gap_diameter_m,
            "gap_seeds": self.gap_seeds,
            "ceiling": self.ceiling,
            "scores": self.scores,
            "seconds": self.seconds,
            "maps": self.maps,
            "failed": self.failed,
            "protocol": self.protocol,
            "gaps": self.gaps,
            "curves": self.curves,
            **about,
        }


ERROR_METRICS = ("error_auc_spread", "error_auc_doubt")
ERRORS = "errors"
"""Of voxels in gaps, from mappers that say how unsure they are; and the share of these that are errors, without which, or with nothing
else, areas under their curves say nothing."""
OF_OCCUPIED = ("recall", "f1", "best_f1", "iou", "auc")
"""Metrics that say nothing where nothing is occupied."""
OF_FREE = ("free_recall", "auc")
"""Those that say nothing where nothing is free."""
PRECISIONS = {"precision": "recall", "free_precision": "free_recall"}
"""By each precision the recall of the same kind."""


def asked(metrics: dict[str, list[float]], metric: str) -> list[float]:
    """A metric of a region, one number per gap seed in which it says anything.

    Of a seed in which the region is empty, in which all of it is of one kind (or is an error, or none is), or in which nothing was called
    occupied (or free) of which there could be a precision, `score` says 0 or 0.5, which would make a mean of several seeds better, or
    worse, than it is. The precision of a map that calls nothing so in any seed stays 0.
    """
    values = metrics.get(metric, [])
    if not values:
        return values
    told = [count > 0 for count in metrics.get("count", [])] or [True] * len(values)
    if "base_rate" in metrics:
        least, most = metric in OF_OCCUPIED, metric in OF_FREE
        told = [some and (base > 0 or not least) and (base < 1 or not most) for some, base in zip(told, metrics["base_rate"], strict=True)]
    if metric in ERROR_METRICS and ERRORS in metrics:  # results of earlier versions have none
        told = [some and 0 < share < 1 for some, share in zip(told, metrics[ERRORS], strict=True)]
    if metric in PRECISIONS:
        found = [some and bool(called) for some, called in zip(told, _called(metrics, metric), strict=True)]
        told = found if any(found) else told
    return [value for value, tells in zip(values, told, strict=True) if tells]


def calls_any(metrics: dict[str, list[float]], metric: str) -> bool:
    """Whether a map calls anything, with any gap seed, of which `metric`, one of `PRECISIONS`, tells how much is right."""
    return metric in metrics and any(_called(metrics, metric))


def _called(metrics: dict[str, list[float]], metric: str) -> list[int]:
    """How many were called with each gap seed what `metric`, one of `PRECISIONS`, is of, from the shares of which `score` tells; 1 where
    these leave it open."""
    other = next(name for name in PRECISIONS if name != metric)
    keys = (metric, other, PRECISIONS[other], "known", "count", "base_rate")
    if any(key not in metrics for key in keys):
        return [1] * len(metrics[metric])
    found = []
    for precision, others, recall, known, count, base in zip(*(metrics[key] for key in keys), strict=True):
        share = base if other == "precision" else 1 - base
        rest = recall * share * count / others if others else 0.0
        open_ = precision > 0 or not others and known > 0  # all that was called occupied, or free, was wrong
        found.append(1 if open_ else round(known * count - rest))
    return found


def _chained(first: dict, second: dict) -> dict:
    """Two trees of the same keys with the lists at their leaves one after the other."""
    both = {**first, **second}
    for key in first.keys() & second.keys():
        one, other = first[key], second[key]
        both[key] = one + other if isinstance(one, list) else _chained(one, other)
    return both
