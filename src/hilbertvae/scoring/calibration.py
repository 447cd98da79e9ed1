"""The `rank` weights of the Hilbert Map, learned on sites that the network has not been trained on (METHOD 5)."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.gaps import OUTSIDE, RIM, random_gaps
from hilbertvae.grids.cluster_grids import GridSettings, find_frames
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.newton_logistic import logistic_weights
from hilbertvae.mappers.weights import OCCUPIED_WEIGHT, RankWeights, fit_rank_weights
from hilbertvae.progress import track
from hilbertvae.scoring.cases import given_cloud, occluded_parts, occlusion_case
from hilbertvae.site import Site

MOST_QUERIES = 400_000
HEARS_SPREAD = {2: True, 3: False}
"""Whether a weight is learned for how far boxes disagree: in 2D that helps some networks, and others learn next to none; in 3D it is wrong
on the next gap seed already (docs/decisions.md, "Weights that hold on other sites")."""
LEARNING = "Learning the map's weights"


def check_learnable(site: Site, grid: GridSettings, gap_diameter_m: float, seeds: list[int]) -> None:
    """An `InputError` if a site is too small to learn a map's weights on: no gap fits into it, or what is left around gaps makes no
    cluster. Who trains a network asks before, not after, since a training may take a day."""
    for seed in seeds:
        shown = random_gaps(site.fit, gap_diameter_m, site.resolution_m, seed).cut(site.fit)
        if not len(find_frames(shown, grid, seed)):
            within = f"{grid.minimum_points} voxels with returns within {grid.cluster_diameter_m / 2:g} m"
            raise InputError(f"expected more than {within} somewhere, outside of gaps of {gap_diameter_m:g} m")


def learn_rank_weights(
    mapper: HilbertMap,
    sites: Sequence[Site],
    gap_diameter_m: float,
    seeds: list[int],
    occlusion: bool = True,
    occupied_weight: float = OCCUPIED_WEIGHT,
    given: str = "scans",
) -> dict[str, dict]:
    """Plain rank weights by reading (`points`, `voxels`), from inputs of all `sites` with parts hidden, and what was hidden.

    Hidden are gaps and held-out beams, and for `voxels` also what scans that were left out saw (`occlusion`): a map that is sure in
    gaps alone would be as sure behind things. One network serves both readings; only these weights differ: a probability is
    calibrated for the cells it was fitted on, the cuts for the points, of which an occupied one counts for `occupied_weight`.
    given: what maps are shown of the sites, as `Protocol.given` has it.
    """
    gathered: dict[str, list] = {"points": [], "voxels": []}
    as_read = {reading: copy.copy(mapper).set_params(calibration=reading) for reading in gathered}
    most = MOST_QUERIES // (len(seeds) * len(sites))

    def gather(reading: str, cloud: Cloud, asked: np.ndarray, seed: int) -> None:
        if len(asked) > most:
            asked = np.random.default_rng(seed).choice(asked, most, replace=False)
        features = as_read[reading].fit_as(mapper).features(cloud.points[asked])
        gathered[reading].append((*features, cloud.occupied[asked]))

    def show(shown: Cloud, seed: int) -> None:
        mapper.set_params(seed=seed).fit(shown.points, shown.occupied, shown.weight)

    for site, seed in track(list(product(sites, seeds)), f"{LEARNING} from gaps", transient=True):
        gaps = random_gaps(site.fit, gap_diameter_m, site.resolution_m, seed)
        show(given_cloud(site, given, gaps), seed)
        for reading, cloud, held_out in (
            ("points", site.points, site.points_held_out),
            ("voxels", site.voxels, site.voxels_held_out),
        ):
            part = gaps.part(cloud.points)
            gather(reading, cloud, np.flatnonzero((part != RIM) & (held_out | (part != OUTSIDE))), seed)
    for site, region, kept, seed in track(
        _occlusions(sites, seeds) if occlusion else [], f"{LEARNING} from what is occluded", transient=True
    ):
        case = site.remember((region, given, kept.tobytes()), partial(occlusion_case, site, region, kept, given))
        asked = case.asked["voxels"]
        if len(asked.points) and case.shown.occupied.any():
            show(case.shown, seed)
            gather("voxels", Cloud(asked.points, asked.occupied, np.ones(len(asked.points))), np.arange(len(asked.points)), seed)
    counts = {"points": occupied_weight, "voxels": 1.0}
    queries = {name: list(map(np.concatenate, zip(*portions, strict=True))) for name, portions in gathered.items()}
    learned = {name: fit_rank_weights(*asked, counts[name], HEARS_SPREAD[sites[0].dimension]) for name, asked in queries.items()}
    # Gaps leave few places without a box, so only what is occluded tells what is beyond them: of voxels.
    beyond = learned["voxels"].beyond
    if beyond.any():
        beyond = beyond + [0.0, _odds_of_points(learned["voxels"], *queries["points"], counts["points"])]
    learned["points"] = replace(learned["points"], beyond=beyond)
    return {name: weights.plain() for name, weights in learned.items()}


def _odds_of_points(voxels: RankWeights, values, held, seen, evidence, away, occupied, occupied_weight: float) -> float:
    """By how much the log-odds of points are above those that a voxel has at their place, where boxes answer alone: points are where
    something is, and a voxel counts once however many are in it."""
    chosen = ~seen & (held > 0)
    as_voxels = voxels.logit(values, held, seen, evidence, away)[chosen]
    counts = np.where(occupied[chosen], occupied_weight, 1.0)
    return float(logistic_weights(np.ones((len(as_voxels), 1)), occupied[chosen], nonnegative=[], offset=as_voxels, counts=counts)[0])


def _occlusions(sites: Sequence[Site], seeds: list[int]) -> list[tuple]:
    """(site, region, scans that are kept, seed): each choice of scans once, however many seeds make it."""
    found = {}
    for number, site in enumerate(sites):
        for seed in seeds:
            for region, kept in occluded_parts(site.scans, seed).items():
                found[number, kept.tobytes()] = (site, region, kept, seed)
    return list(found.values())
