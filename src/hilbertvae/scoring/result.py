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

    def add(self, other: Result) -> Result:
        """This result with the mappers of another evaluation of the same site under the same protocol."""
        for name in ("site", "gap_seeds", "protocol"):
            if getattr(self, name) != getattr(other, name):
                raise ValueError(f"results differ in {name}: {getattr(self, name)!r} and {getattr(other, name)!r}")
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


def asked(metrics: dict[str, list[float]], metric: str) -> list[float]:
    """A metric of a region, one number per gap seed in which it has any point or voxel. Of a seed in which it is empty `score` says 0,
    which would make a mean of several seeds better, or worse, than it is."""
    values, counts = metrics.get(metric, []), metrics.get("count", [])
    return [value for value, count in zip(values, counts, strict=True) if count > 0] if values and counts else values


def _chained(first: dict, second: dict) -> dict:
    """Two trees of the same keys with the lists at their leaves one after the other."""
    both = {**first, **second}
    for key in first.keys() & second.keys():
        one, other = first[key], second[key]
        both[key] = one + other if isinstance(one, list) else _chained(one, other)
    return both
