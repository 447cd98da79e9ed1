"""From a cloud to the aligned grids of its clusters: the one way that training, mappers and pictures all take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hilbertvae.checks import InputError, check_positive, check_whole
from hilbertvae.cloud import OCCUPIED_SHARE, READINGS, Cloud
from hilbertvae.clusters.clusters import Clusters
from hilbertvae.clusters.starts import check_start, find_clusters
from hilbertvae.grids.aligned_grid import UNKNOWN, IndexedCloud, Members, bin_members, count_code, count_votes, mean_places, vote
from hilbertvae.grids.frame import Frames, FrameSettings, cluster_frames

COUNTS, PLACES = slice(1, 3), 3
"""Of the channels of `bin_detailed`: those with counts, and where places in cells begin."""


@dataclass
class GridSettings:
    """Clusters and their grids. The paper's are 64 cells of a 5 m cluster, majority votes, and the median, full, extent frame."""

    cells: int = 64
    """Cells along each axis of a grid."""
    cluster_diameter_m: float = 6.4
    """2 r_o of Quick-Means, and the side of the box: with 64 cells, cells of one 0.1 m voxel."""
    start: str = "quick_means"
    """How seeds of clusters are found: `quick_means`, `ask_means`, `kmeans_parallel`, `kmeans_plus_plus` or `random`."""
    inner_radius_m: float = 1.375
    """r_i of Quick-Means, threshold of ASK-Means: how far clusters stand apart; 0.55 of the paper's r_o. Other starts find as many."""
    minimum_points: int = 10
    """Occupied points that a cluster has more than."""
    occupied_share: float = OCCUPIED_SHARE
    """Share of hits from which on a cell is occupied; 0.5 is the paper's majority."""
    interpolated: bool | str = False
    """Whether a map reads its grids between cells (`kernel`); the paper reads the cell that a query falls in (Eq. 7). `voxels` or `points`:
    maps that are calibrated for that do."""
    frame: FrameSettings = field(default_factory=FrameSettings)

    @classmethod
    def from_plain(cls, values: dict) -> GridSettings:
        """The settings that a file has as JSON, checked."""
        grid = cls(**{**values, "frame": FrameSettings(**values["frame"])})
        grid.check()
        return grid

    def check(self) -> None:
        """An `InputError` that names the key for a value that makes no grid."""
        check_positive(self.cluster_diameter_m, "grid.cluster_diameter_m")
        check_positive(self.inner_radius_m, "grid.inner_radius_m")
        check_start(self.start, "grid.start")
        if check_whole(self.cells, "grid.cells") < 2:
            raise InputError(f"grid.cells: expected at least 2, got {self.cells}")
        check_whole(self.minimum_points, "grid.minimum_points")
        if self.inner_radius_m > self.cluster_diameter_m / 2:
            raise InputError(f"grid.inner_radius_m: expected at most half of cluster_diameter_m, got {self.inner_radius_m}")
        if not isinstance(self.occupied_share, (int, float, np.number)) or not 0 < self.occupied_share <= 1:
            raise InputError(f"grid.occupied_share: expected a share in (0, 1], got {self.occupied_share!r}")
        if not isinstance(self.interpolated, bool) and self.interpolated not in READINGS:
            raise InputError(f"grid.interpolated: expected true, false or one of {', '.join(READINGS)}, got {self.interpolated!r}")

    @property
    def cell_m(self) -> float:
        """The side of a cell in metres, where the scale is fixed."""
        return self.cluster_diameter_m / self.cells

    def read_between_cells(self, reading: str) -> bool:
        """Whether maps that are calibrated for a reading, `voxels` or `points`, are read between cells."""
        return self.interpolated in (True, reading)


def voxel_grid(resolution_m: float) -> GridSettings:
    """The default's boxes, or nearly, with cells that are the voxels to which points are thinned: finer ones would mostly stay unknown."""
    default = GridSettings()
    cells = max(2, 2 * round(default.cluster_diameter_m / resolution_m / 2))  # even: the sides of boxes lie on those of voxels
    diameter_m = cells * resolution_m
    return replace(default, cells=cells, cluster_diameter_m=diameter_m, inner_radius_m=min(default.inner_radius_m, diameter_m / 2))


def cloud_clusters(cloud: Cloud, settings: GridSettings, seed: int) -> Clusters:
    """Clusters of the cloud's occupied points."""
    returns = cloud.points[cloud.occupied]
    if not len(returns):
        raise InputError("cloud: expected occupied points to cluster, got none")
    radii_m = settings.cluster_diameter_m / 2, settings.inner_radius_m
    return find_clusters(returns, *radii_m, settings.minimum_points, seed, settings.start)


def frames_of(clusters: Clusters, cloud: Cloud, settings: GridSettings) -> Frames:
    """The frames of the cloud's clusters."""
    return cluster_frames(clusters, cloud, settings.cluster_diameter_m, settings.cell_m, settings.frame)


def find_frames(cloud: Cloud, settings: GridSettings, seed: int) -> Frames:
    """Clusters of the cloud's occupied points, and their frames."""
    return frames_of(cloud_clusters(cloud, settings, seed), cloud, settings)


def bin_grids(cloud: Cloud | IndexedCloud, frames: Frames, settings: GridSettings) -> np.ndarray:
    """int8 grids (M, n, ..., n) of all points of the cloud in the frames' boxes."""
    return _bin_channels(cloud, frames, settings, 1, lambda hits, frees: ())[:, 0]


def bin_detailed(cloud: Cloud | IndexedCloud, frames: Frames, settings: GridSettings) -> np.ndarray:
    """int8 (M, 3 + D, n, ..., n) of all points of the cloud in the frames' boxes: in each cell its label, as of `bin_grids`, how many
    returns it has and how many free samples (`count_code`), and where in it its returns lie (`mean_places`)."""
    channels = PLACES + frames.centre.shape[1]
    return _bin_channels(cloud, frames, settings, channels, lambda hits, frees: (count_code(hits), count_code(frees)), places=True)


def bin_shown(cloud: Cloud | IndexedCloud, frames: Frames, settings: GridSettings, detailed: bool) -> np.ndarray:
    """What a network is shown: `bin_detailed`, or labels alone (`bin_grids`)."""
    return (bin_detailed if detailed else bin_grids)(cloud, frames, settings)


def bin_voted(cloud: Cloud, frames: Frames, settings: GridSettings, free_share: float) -> np.ndarray:
    """int8 (M, 2, n, ..., n): labels, and codes (`count_code`) of how many votes each cell has; a free sample is `free_share` of one. A
    known cell has at least the lowest code above 0, so that it weighs something."""

    def code(hits: np.ndarray, frees: np.ndarray) -> tuple[np.ndarray]:
        votes = hits + free_share * frees
        return (np.where(votes > 0, np.maximum(count_code(votes), 1), 0).astype(np.int8),)

    return _bin_channels(cloud, frames, settings, 2, code)


def _bin_channels(
    cloud: Cloud | IndexedCloud, frames: Frames, settings: GridSettings, channels: int, details: Callable, places: bool = False
) -> np.ndarray:
    """int8 (M, channels, n, ..., n): labels, what `details(hits, frees)` makes of the votes, and the places of returns or 0 in the rest."""
    shape = (settings.cells,) * frames.centre.shape[1]
    grids = np.full((len(frames), channels, *shape), UNKNOWN, np.int8)

    def put(found: Members, of: Cloud) -> None:
        hits, frees = count_votes(of, found, shape)
        for channel, values in enumerate((vote(hits, frees, settings.occupied_share), *details(hits, frees))):
            grids[found.frames, channel] = values
        if places:
            grids[found.frames, PLACES:] = mean_places(of, frames, found, settings.cells)

    bin_members(put, cloud, frames, settings.cells)
    return grids


def labels_of(shown: np.ndarray, dimension: int) -> np.ndarray:
    """The labels (M, n, ..., n) of what `bin_shown` or `bin_voted` gives; of torch tensors, too."""
    return shown[:, 0] if shown.ndim == dimension + 2 else shown
