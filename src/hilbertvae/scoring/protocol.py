"""The protocol: how a mapper is scored on a site it has never seen (paper IV; METHOD 7)."""

from __future__ import annotations

import copy
import time
import warnings
from collections import defaultdict
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.gaps import LEAST_SHARE, Gaps, random_gaps
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.training_card import trained_on
from hilbertvae.scans.sites import CATALOGUE
from hilbertvae.scoring.answers import answers, spreads, warn_of_voxels
from hilbertvae.scoring.cases import Case, gap_case, occluded_parts, occlusion_case
from hilbertvae.scoring.ceiling import ceiling
from hilbertvae.scoring.metrics import error_ranking, precision_recall_curve, score
from hilbertvae.scoring.protocol_settings import Protocol
from hilbertvae.scoring.result import Result
from hilbertvae.site import SIMULATED, Site

CURVE_POINTS = 101
"""Recalls at which the precision-recall curve is kept."""


def cut_site(site: Site, protocol: Protocol, seed: int) -> Gaps:
    """The gaps of one seed: the same for every mapper. Warns where the site has no room for as many as METHOD 7 wants."""

    def cut() -> Gaps:
        gaps = random_gaps(site.fit, protocol.gap_diameter_m, site.resolution_m, seed, protocol.centred, rim=protocol.rim)
        if gaps.share < LEAST_SHARE:
            few = f"gaps of {protocol.gap_diameter_m:g} m take {100 * gaps.share:.3g} % of its points"
            warnings.warn(f"{site.name}: {few}, and not {LEAST_SHARE:.0%}: no further one fits", stacklevel=4)
        return gaps

    return site.remember(("gaps", protocol.gap_diameter_m, protocol.centred, protocol.rim, seed), cut)


def evaluate(mapper: Mapper, site: Site, protocol: Protocol | None = None, name: str = "mapper", progress=None) -> Result:
    """Fit the mapper on the gapped site once per gap seed, and score it on what was hidden and on what was not.

    Every mapper gets the same `fit` points and, of a gap, neither points nor their places; one that takes a `seed` gets the gap's. The one
    that is given stays as it is: a copy of it is fitted.
    site: as `open_site` makes it. protocol: gap seeds and sizes; METHOD 7's (five gaps of 2.5 m, and real occlusion) unless given. name:
    the mapper's in the result. `progress`, if given, is called with a line of text as each seed is done.
    The result's `scores[name]["points" or "voxels"][region][metric]` is a list with a float per gap seed: shares from 0 to 1, NLL in nats.
    Raises `InputError` for anything but a `Mapper` and a `Site`, for settings that can't be scored, and for a site too small for a gap.
    """
    return evaluate_alike({name: copy.copy(mapper)}, site, protocol or Protocol(), progress)  # scikit-learn's clone would copy its network


def evaluate_alike(mappers: dict[str, Mapper], site: Site, protocol: Protocol, progress=None) -> Result:
    """`evaluate` of mappers by name that fit alike (`Mapper.fits_like`): the first is fitted for all, and its seconds are theirs."""
    protocol.check()
    if not isinstance(site, Site):  # a name or a path is one elsewhere
        raise InputError(f"site: expected a hilbertvae.site.Site, as open_site makes it, got {type(site).__name__}")
    first, *others = mappers.values()
    for name, mapper in mappers.items():
        if not isinstance(mapper, Mapper):
            raise InputError(f"{name}: expected a hilbertvae.mappers.mapper.Mapper, got {type(mapper).__name__}")
        if mapper is not first and not mapper.fits_like(first):
            raise InputError(f"{name}: expected one that fits as {next(iter(mappers))} does (Mapper.fits_like); evaluate_all takes any")
        _warn_if_trained_on(mapper, name, site)
    found = {name: _Found() for name in mappers}
    every_gap = []
    for seed in protocol.gap_seeds:
        gaps = cut_site(site, protocol, seed)
        every_gap.append({"seed": seed, "centres": gaps.centres.tolist(), "radius_m": gaps.radius_m.tolist(), "share": gaps.share})
        for mapper in mappers.values():
            _prepare(mapper, seed, gaps)
        key = ("gap case", protocol.gap_diameter_m, protocol.centred, protocol.rim, protocol.given, seed)
        cases = [site.remember(key, lambda gaps=gaps: gap_case(site, gaps, protocol.given))]
        if protocol.occlusion and not first.told_gaps:
            for region, kept in occluded_parts(site.scans, seed).items():
                key = (region, protocol.given, kept.tobytes())
                cases.append(site.remember(key, lambda region=region, kept=kept: occlusion_case(site, region, kept, protocol.given)))
        for case in cases:
            taken = _fit(first, case.shown)
            for mapper in others:
                mapper.fit_as(first)
            for name, mapper in mappers.items():
                asked = found[name].ask(mapper, case)
                if case is cases[0]:  # maps of the gapped site: other cases have other points
                    found[name].seconds["fit"].append(taken)
                    found[name].seconds["query_per_million"].append(asked)
                    _weigh(mapper, found[name].maps)
                    if seed == protocol.gap_seeds[0]:
                        warn_of_voxels(mapper, name, site)
        if progress:
            for name, one in found.items():
                f1, auc, asked = (one.rows["voxels"]["gaps"][metric][-1] for metric in ("f1", "auc", "count"))
                said = f"gaps F1 {f1:.3f} AUC {auc:.3f} (voxels)" if asked else "no voxel is asked in its gaps"
                progress(f"{name} on {site.name}, gap seed {seed}: {said}")
    return Result(
        site=site.name,
        dimension=site.dimension,
        gap_diameter_m=protocol.gap_diameter_m,
        gap_seeds=list(protocol.gap_seeds),
        ceiling=site.remember("ceiling", lambda: ceiling(site)),
        scores={name: one.scores() for name, one in found.items()},
        seconds={name: dict(one.seconds) for name, one in found.items()},
        maps={name: dict(one.maps) for name, one in found.items()},
        gaps=every_gap,
        curves={name: dict(one.curves) for name, one in found.items()},
        protocol=asdict(protocol),
    )


@dataclass
class _Found:
    """What is found of one mapper, case by case."""

    rows: dict = field(default_factory=lambda: defaultdict(lambda: defaultdict(lambda: defaultdict(list))))
    seconds: dict = field(default_factory=lambda: defaultdict(list))
    maps: dict = field(default_factory=lambda: defaultdict(list))
    curves: dict = field(default_factory=lambda: defaultdict(list))

    def ask(self, mapper: Mapper, case: Case) -> float:
        """Scores the case; the seconds that a million of its queries take."""
        taken = 0.0
        for reading, asked in case.asked.items():
            probability, seconds = answers(mapper, asked.points)
            taken += seconds
            for region, chosen in asked.regions.items():
                for metric, value in score(asked.occupied[chosen], probability[chosen]).items():
                    self.rows[reading][region][metric].append(value)
                if region == "gaps":
                    self.curves[reading].append(_curve(asked.occupied[chosen], probability[chosen]))
                    if reading == "voxels" and hasattr(mapper, "predict_std"):
                        spread = spreads(mapper, asked.points[chosen])
                        for metric, value in error_ranking(asked.occupied[chosen], probability[chosen], spread).items():
                            self.rows[reading][region][metric].append(value)
        return taken / max(sum(len(asked.points) for asked in case.asked.values()), 1) * 1e6

    def scores(self) -> dict:
        return {reading: {region: dict(found) for region, found in regions.items()} for reading, regions in self.rows.items()}


def _prepare(mapper: Mapper, seed: int, gaps: Gaps) -> None:
    if "seed" in mapper.get_params(deep=False):
        mapper.set_params(seed=seed)
    if mapper.told_gaps:  # the leak check: it knows where the gaps are, and nothing else
        mapper.set_params(centres=gaps.centres)


def _fit(mapper: Mapper, cloud: Cloud) -> float:
    """Fit the mapper; the seconds that it took."""
    start = time.perf_counter()
    mapper.fit(cloud.points, cloud.occupied, cloud.weight)
    return time.perf_counter() - start


def _weigh(mapper: Mapper, maps: dict) -> None:
    maps["bytes"].append(mapper.stored_bytes())
    if (count := mapper.cluster_count()) is not None:
        maps["clusters"].append(count)


def _curve(occupied: np.ndarray, probability: np.ndarray) -> list[float]:
    """Precision at `CURVE_POINTS` recalls from 0 to 1, each the best at that recall or more."""
    if not occupied.any():
        return [0.0] * CURVE_POINTS
    _, precision, recall = precision_recall_curve(occupied, probability)
    best = np.maximum.accumulate(precision[::-1])[::-1]
    return [round(float(p), 5) for p in best[np.searchsorted(recall, np.linspace(0, 1, CURVE_POINTS) - 1e-12)]]


def _warn_if_trained_on(mapper: Mapper, name: str, site: Site) -> None:
    """Training and evaluation never share a site (METHOD 0). `hilbertvae-train` refuses to; whoever calls this may want to see it. A site
    knows its name alone, that of its file or folder where it was at a path."""
    sites, simulated = trained_on(getattr(getattr(mapper, "reconstructor", None), "card", {}))
    names = {*sites, *(Path(path).name for site in sites for path in (site, CATALOGUE[site].file if site in CATALOGUE else site))}
    number = site.name.removeprefix(SIMULATED)
    if site.name in names or (number != site.name and number.isdecimal() and any(int(number) in many for many in simulated)):
        warnings.warn(f"{name}: {site.name} is among what its network was trained on; its scores say nothing of other places", stacklevel=4)


def evaluate_all(mappers: dict[str, Mapper], site: Site, protocol: Protocol, progress=None, kept=None) -> Result:
    """One `Result` of all mappers by name. One that fails is named in `failed`, and the others are scored all the same.

    kept: what `evaluate_alike` found before with one gap seed, by `take(mappers, seed)`; it is handed what is found by
    `keep(mappers, seed, result)`, so that an evaluation which was stopped goes on.
    """
    protocol.check()  # as a whole: each seed alone may well do
    every = None
    for seed in protocol.gap_seeds:  # all mappers in turn, since a site remembers the cases of few seeds
        going = {name: mapper for name, mapper in mappers.items() if every is None or name not in every.failed}
        found = _evaluate_groups(alike(going), site, replace(protocol, gap_seeds=[seed]), progress, kept)
        every = found if every is None else every.followed_by(found)
    return every


def _evaluate_groups(groups: list[dict[str, Mapper]], site: Site, protocol: Protocol, progress, kept) -> Result:
    """One `Result` of mappers that fit alike by groups, with one gap seed. Where a group fails, each of it is evaluated alone: one of them
    may have failed the others."""
    best = site.remember("ceiling", lambda: ceiling(site))
    every = Result(site.name, site.dimension, protocol.gap_diameter_m, list(protocol.gap_seeds), best, protocol=asdict(protocol))
    for group in groups:
        try:
            found = _evaluate_seed(group, site, protocol, progress, kept)
        except BrokenPipeError:  # whoever read of the progress is gone, which no mapper can help
            raise
        except Exception as error:
            if len(group) > 1:
                found = _evaluate_groups([{name: mapper} for name, mapper in group.items()], site, protocol, progress, kept)
            else:
                (name,) = group
                why = f"{type(error).__name__}: {error}"
                found = replace(every, scores={}, seconds={}, maps={}, curves={}, gaps=[], failed={name: why})
                if progress:
                    progress(f"{name} on {site.name} failed: {why}")
        every.gaps = every.gaps or found.gaps
        every.add(found)
    return every


def _evaluate_seed(mappers: dict[str, Mapper], site: Site, protocol: Protocol, progress, kept) -> Result:
    (seed,) = protocol.gap_seeds
    if kept and (before := kept.take(mappers, seed)):
        if progress:
            progress(f"{', '.join(mappers)} on {site.name}, gap seed {seed}: scored before")
        return before
    found = evaluate_alike(mappers, site, protocol, progress)
    if kept:
        kept.keep(mappers, seed, found)
    return found


def alike(mappers: dict[str, Mapper]) -> list[dict[str, Mapper]]:
    """The mappers by name, those that fit alike together."""
    groups: list[dict[str, Mapper]] = []
    for name, mapper in mappers.items():
        known = next((group for group in groups if mapper.fits_like(next(iter(group.values())))), None)
        if known is None:
            groups.append(known := {})
        known[name] = mapper
    return groups
