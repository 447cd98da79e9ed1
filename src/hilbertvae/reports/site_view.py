"""One 3D site as its pictures need it: the occupied voxels that were shown, that there are and that a map has; gaps worth a look."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from hilbertvae.cloud import Cloud, labelled_voxels
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
    def draw(cls, site: Site, gaps: Gaps, cloud: Cloud, mapper: Mapper, by_points: Mapper | None = None) -> SiteView:
        """Ask a mapper, already fitted on `cloud`, what is shown of the site outside of `gaps`, at each voxel near it; `by_points`, too."""

        def field(mapper: Mapper) -> Field:
            return Field.near(mapper.predict_map, cloud.points, site.resolution_m)

        def voxels(centres: np.ndarray, probability: np.ndarray | None = None) -> Voxels:
            height = site.ground.height_above(centres)
            chosen = height > UNDERGROUND_M
            centres, height = centres[chosen], height[chosen]
            return Voxels(centres, height, mapper.predict_map(centres) if probability is None else probability[chosen])

        labelled = labelled_voxels(cloud, site.resolution_m)
        shown, truth = (voxels(seen.points[seen.occupied]) for seen in (labelled, site.voxels))
        sensors = site.scans.origins[np.unique(site.scans.scan, return_index=True)[1]]
        asked = field(mapper)
        mapped = voxels(*asked.above(OCCUPIED_ABOVE))
        for_points = voxels(*field(by_points).above(OCCUPIED_ABOVE)) if by_points else None
        return cls(site.name, site.resolution_m, gaps, site.ground, mapper, shown, truth, mapped, cloud, sensors, asked, for_points)

    def in_gaps(self, voxels: Voxels) -> np.ndarray:
        """(N,) bool: the voxels that lie in a gap."""
        return self.gaps.part(voxels.centres) == INSIDE


def one_gap(gaps: Gaps, gap: int) -> Gaps:
    """The gap of that number alone."""
    return replace(gaps, centres=gaps.centres[[gap]], radius_m=gaps.radius_m[[gap]])


def fullest_gap(view: SiteView) -> int:
    """The number of the gap that hides the most occupied voxels above ground."""
    above = view.truth.centres[view.truth.height_m > ABOVE_GROUND_M]
    return int(np.argmax(view.gaps.count(above)))


def telling_gaps(view: SiteView, count: int = 5) -> dict[int, str]:
    """Gaps worth a closer look, and why: one in an object of a car's size, one in a tree or a pole, and the fullest above ground.

    The choice knows the truth and no mapper's answer.
    """
    above = view.truth.select(view.truth.height_m > ABOVE_GROUND_M)
    hiding, number = view.gaps.gap_of(above.centres), view.gaps.count(above.centres)
    order = [int(gap) for gap in np.argsort(-number, kind="stable") if number[gap]]
    size = {gap: _object_size(view, above, gap, hiding == gap) for gap in order}
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
