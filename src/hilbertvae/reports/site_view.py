"""One 3D site as its pictures need it: the occupied voxels that were shown, that there are and that a map has; gaps worth a look."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from hilbertvae.cloud import OCCUPIED_SHARE, Cloud
from hilbertvae.drawing.field import Field
from hilbertvae.gaps import INSIDE, Gaps
from hilbertvae.ground import ABOVE_GROUND_M, Ground
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE, Mapper
from hilbertvae.site import Site
from hilbertvae.voxel_votes import voxel_index

UNDERGROUND_M = -0.6
"""What lies deeper is a reflection, and is not drawn."""
CAR_M, LONGEST_CAR_M = (1.0, 2.2), 6.0
"""What is taken for a car: its height above ground, and its longer side."""
TREE_M, WIDEST_TREE_M = 3.0, 8.0
"""What is taken for a tree or a pole."""


@dataclass(frozen=True)
class Voxels:
    """centres: (N, 3) metres, map frame; height_m: (N,) above the ground; probability: (N,) the map's p(occupied) there."""

    centres: np.ndarray
    height_m: np.ndarray
    probability: np.ndarray

    def select(self, chosen: np.ndarray) -> Voxels:
        """The voxels at `chosen`, a mask or indices."""
        return Voxels(self.centres[chosen], self.height_m[chosen], self.probability[chosen])


@dataclass(frozen=True)
class SiteView:
    """The occupied voxels of one 3D site: as the mapper was shown them, in truth, and as the map has them (p > 0.6)."""

    name: str
    resolution_m: float
    gaps: Gaps
    ground: Ground
    mapper: Mapper
    shown: Voxels
    truth: Voxels
    map: Voxels
    cloud: Cloud
    """What the mapper was shown, free and occupied."""
    sensors: np.ndarray
    """(S, 3) metres: where each sweep began."""
    field: Field
    """What the map says near data, as its surface needs it, too: asking takes longer than all else."""
    for_points: Voxels | None = None
    """As `map`, by a mapper whose weights are calibrated for points (the paper's reading), if there is one."""

    @classmethod
    def draw(cls, site: Site, gaps: Gaps, mapper: Mapper, by_points: Mapper | None = None) -> SiteView:
        """Ask a mapper, already fitted on `gaps.cut(site.fit)`, at each voxel near that cloud; `by_points`, too."""
        cloud = gaps.cut(site.fit)

        def field(mapper: Mapper) -> Field:
            return Field.near(mapper.predict_map, cloud.points, site.resolution_m)

        def voxels(centres: np.ndarray, probability: np.ndarray | None = None) -> Voxels:
            height = site.ground.height_above(centres)
            chosen = height > UNDERGROUND_M
            centres, height = centres[chosen], height[chosen]
            return Voxels(centres, height, mapper.predict_map(centres) if probability is None else probability[chosen])

        shown, truth = voxels(_voted(cloud, site.resolution_m)), voxels(site.voxels.points[site.voxels.occupied])
        sensors = site.scans.origins[np.unique(site.scans.scan, return_index=True)[1]]
        asked = field(mapper)
        mapped = voxels(*asked.above(OCCUPIED_ABOVE))
        for_points = voxels(*field(by_points).above(OCCUPIED_ABOVE)) if by_points else None
        return cls(site.name, site.resolution_m, gaps, site.ground, mapper, shown, truth, mapped, cloud, sensors, asked, for_points)

    def in_gaps(self, voxels: Voxels) -> np.ndarray:
        """(N,) bool: the voxels that lie in a gap."""
        return self.gaps.part(voxels.centres) == INSIDE


def _voted(cloud: Cloud, resolution_m: float) -> np.ndarray:
    """(V, 3) centres of the voxels that are occupied by the votes of the cloud's points."""
    index = voxel_index(cloud.points, resolution_m)
    low = index.min(axis=0)
    shape = tuple(index.max(axis=0) - low + 1)
    found, place = np.unique(np.ravel_multi_index(tuple((index - low).T), shape), return_inverse=True)
    votes, hits = (np.bincount(place, weights=w, minlength=len(found)) for w in (cloud.weight, cloud.weight * cloud.occupied))
    chosen = found[hits >= np.maximum(OCCUPIED_SHARE * votes, 1e-12)]
    return (np.stack(np.unravel_index(chosen, shape), axis=1) + low + 0.5) * resolution_m


def one_gap(gaps: Gaps, gap: int) -> Gaps:
    """The gap of that number alone."""
    return replace(gaps, centres=gaps.centres[[gap]], radius_m=gaps.radius_m[[gap]])


def fullest_gap(view: SiteView) -> int:
    """The number of the gap that hides the most occupied voxels above ground."""
    above = view.truth.centres[view.truth.height_m > ABOVE_GROUND_M]
    return int(np.argmax([np.count_nonzero(one_gap(view.gaps, gap).part(above) == INSIDE) for gap in range(len(view.gaps.centres))]))


def telling_gaps(view: SiteView, count: int = 5) -> dict[int, str]:
    """Gaps worth a closer look, and why: one in an object of a car's size, one in a tree or a pole, and the fullest above ground.

    The choice knows the truth and no mapper's answer.
    """
    above = view.truth.select(view.truth.height_m > ABOVE_GROUND_M)
    hidden = [one_gap(view.gaps, gap).part(above.centres) == INSIDE for gap in range(len(view.gaps.centres))]
    number = np.array([np.count_nonzero(chosen) for chosen in hidden])
    order = [int(gap) for gap in np.argsort(-number, kind="stable") if number[gap]]
    size = {gap: _object_size(view, above, gap, hidden[gap]) for gap in order}
    cars = [gap for gap in order if CAR_M[0] <= size[gap][0] <= CAR_M[1] and CAR_M[0] <= size[gap][1] <= LONGEST_CAR_M]
    trees = [gap for gap in order if size[gap][0] > TREE_M and size[gap][1] <= WIDEST_TREE_M]
    chosen = {gap: "as large as a car" for gap in cars[:1]} | {gap: "as large as a tree" for gap in trees[:1]}
    for gap in order:
        if len(chosen) >= count:
            break
        chosen.setdefault(gap, "among the fullest")
    return {gap: f"{why}, hides {number[gap]} voxels" for gap, why in list(chosen.items())[:count]}


def _object_size(view: SiteView, above: Voxels, gap: int, hidden: np.ndarray) -> tuple[float, float]:
    """(height above ground, longer horizontal side) in metres of the connected voxels that most of a gap's are part of."""
    reach = view.gaps.radius_m[gap] + WIDEST_TREE_M
    near = np.abs(above.centres[:, :2] - view.gaps.centres[gap, :2]).max(axis=1) <= reach
    index = voxel_index(above.centres[near], view.resolution_m)
    index -= index.min(axis=0)
    grid = np.zeros(index.max(axis=0) + 1, bool)
    grid[tuple(index.T)] = True
    # Laser rings leave gaps of a voxel between what belongs together.
    label = ndimage.label(ndimage.binary_dilation(grid))[0][tuple(index.T)]
    part = label == np.bincount(label[hidden[near]]).argmax()
    return float(above.height_m[near][part].max()), float(np.ptp(above.centres[near][part, :2], axis=0).max() + view.resolution_m)
