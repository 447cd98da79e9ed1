"""Pairs of grids to learn from: what is left of a site after gaps, and the same boxes uncut (METHOD 3 and 4)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError, check_share
from hilbertvae.cloud import FREE_POINT_M, Cloud, fit_cloud, labelled_voxels, placed_as
from hilbertvae.gaps import Gaps, NoRoom, is_range, random_gaps
from hilbertvae.grids.cluster_grids import GridSettings, bin_grids, bin_shown, bin_voted, find_frames
from hilbertvae.observed_map import FINE, map_of
from hilbertvae.occlusions import random_occlusion
from hilbertvae.scans.scan import Scans


@dataclass
class ClusteringSettings:
    """How a training site is clustered, once per seed (the paper: 20 times, without gaps)."""

    clusterings: int = 20
    gap_diameter_m: list[float] = field(default_factory=lambda: [1.5, 3.5])
    """Range of the diameters of the gaps that each clustering cuts from its input; an empty list cuts none."""
    occluded_share: float = 0.0
    """Share of the clusterings that are shown a site that was scanned less (`occlusions.py`) instead of one with gaps."""
    mapped_share: float = 0.0
    """Share of the clusterings that are shown what an existing map would say instead: labels of cells alone (`observed_map.py`), which are
    as large as voxels or half as large, each by one chance in two."""
    turn: bool = True
    """Each clustering but the first turns the site about the vertical by a random angle."""

    def __post_init__(self):
        for key in ("occluded_share", "mapped_share"):
            check_share(getattr(self, key), f"clustering.{key}")
        if isinstance(self.gap_diameter_m, np.ndarray):  # numpy's numbers are none in JSON
            self.gap_diameter_m = self.gap_diameter_m.tolist()
        sizes = self.gap_diameter_m
        if sizes and not is_range(sizes):
            raise InputError(f"clustering.gap_diameter_m: expected the smallest and the largest, or an empty list, got {sizes}")


def turned(scans: Scans, angle_rad: float) -> Scans:
    """The scans turned about the vertical axis through the map's origin."""
    turn = np.eye(scans.dimension)
    turn[:2, :2] = [[np.cos(angle_rad), np.sin(angle_rad)], [-np.sin(angle_rad), np.cos(angle_rad)]]
    return Scans(scans.points @ turn, scans.origins @ turn, scans.scan, scans.beam)


def training_grids(
    scans: Scans,
    resolution_m: float,
    grid: GridSettings,
    clustering: ClusteringSettings,
    seed: int,
    detailed: bool = False,
    voted: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """(shown, target): int8 grids (M, n, ..., n) of one clustering, without and with what its gaps, or an occlusion, removed; with
    `detailed`, what is shown is (M, 3 + D, n, ..., n), as `bin_detailed` makes it, and with `voted` the target is (M, 2, n, ..., n), as
    `bin_voted` makes it, with as many votes as the `points` cloud has points.

    The gaps are cut by the evaluation's code before anything else, so that clusters and frames are those of a gapped site; the target
    is the uncut site, binned in the same frames. Raises `NoRoom` for a site too small for gaps.
    """
    rng = np.random.default_rng([seed, 0x9A15])
    if clustering.turn:
        scans = turned(scans, rng.uniform(0, 2 * np.pi))
    whole = cloud = fit_cloud(scans, resolution_m)
    gaps, sizes = None, tuple(clustering.gap_diameter_m)
    if rng.random() < clustering.occluded_share:
        scans = scans.select(random_occlusion(scans, seed))
        cloud = fit_cloud(scans, resolution_m)
        whole = placed_as(whole, cloud, resolution_m)  # or a turned box would take for hidden what is shown a cell further
    elif sizes:
        gaps = random_gaps(whole, sizes, resolution_m, seed)
        cloud = _cut(gaps, whole, sizes)
    if rng.random() < clustering.mapped_share:
        whole = placed_as(whole, labelled_voxels(cloud, resolution_m), resolution_m)
        cell_m = resolution_m / rng.choice([1, FINE])
        voxel_m = rng.choice([cell_m, resolution_m])  # a map is filled in its own cells, unless asked for in others
        if cell_m < resolution_m:
            cloud = fit_cloud(scans, cell_m)
            cloud = _cut(gaps, cloud, sizes) if gaps else cloud
        cloud = map_of(cloud, cell_m, voxel_m)
    frames = find_frames(cloud, grid, seed)
    target = bin_voted(whole, frames, grid, resolution_m / FREE_POINT_M) if voted else bin_grids(whole, frames, grid)
    return bin_shown(cloud, frames, grid, detailed), target


def gapped_grids(
    cloud: Cloud, resolution_m: float, grid: GridSettings, gap_diameter_m: tuple[float, float], seed: int, detailed: bool, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """(shown, target): int8 grids of one clustering, without and with what gaps removed, as `training_grids` makes them, but of a `cloud`
    whose scans are not there. `most`: of more clusters than that, so many are drawn. Raises `NoRoom` for a cloud too small for gaps."""
    cut = _cut(random_gaps(cloud, gap_diameter_m, resolution_m, seed), cloud, gap_diameter_m)
    frames = find_frames(cut, grid, seed)
    if len(frames) > most:
        drawn = np.sort(np.random.default_rng([seed, 0x6A9]).permutation(len(frames))[:most])
        frames = frames.select(drawn)
    return bin_shown(cut, frames, grid, detailed), bin_grids(cloud, frames, grid)


def _cut(gaps: Gaps, cloud: Cloud, gap_diameter_m: tuple[float, float]) -> Cloud:
    """What gaps of these sizes leave of the cloud; `NoRoom` where they take every return."""
    cut = gaps.cut(cloud)
    if not cut.occupied.any():
        raise NoRoom(f"gaps of {gap_diameter_m} m: leave no occupied point of this site")
    return cut
