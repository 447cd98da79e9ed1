"""Which queries count in which rows; the rest of the protocol is tested through `evaluate`."""

import numpy as np
import pytest

from hilbertvae.cloud import voxel_cloud
from hilbertvae.gaps import INSIDE, OUTSIDE, random_gaps
from hilbertvae.ground import ABOVE_GROUND_M
from hilbertvae.observed_map import cloud_of_cells
from hilbertvae.scoring import cases
from hilbertvae.scoring.cases import gap_case, occluded_parts, occlusion_case


def part_of(site, gaps, reading, region):
    """The points of a region by the protocol's words, one by one."""
    cloud, held_out = (site.points, site.points_held_out) if reading == "points" else (site.voxels, site.voxels_held_out)
    fitted = ~held_out if reading == "points" else site.voxels_fitted
    part = gaps.part(cloud.points)
    chosen = {"gaps": part == INSIDE, "observed": held_out & (part == OUTSIDE), "fitted": fitted & (part == OUTSIDE)}[region.split("-")[0]]
    if "ground" in region:
        chosen &= (site.ground.height_above(cloud.points) > ABOVE_GROUND_M) == ("above" in region)
    return cloud.points[chosen]


@pytest.mark.parametrize("reading", ["points", "voxels"])
def test_regions_hold_what_their_names_say(place, reading):
    gaps = random_gaps(place.fit, 1.5, place.resolution_m, 0)
    asked = gap_case(place, gaps).asked[reading]
    split = {f"{region}-{side}-ground" for region in ("observed", "gaps") for side in ("near", "above")}
    assert set(asked.regions) == {"observed", "fitted", "gaps"} | (split if place.dimension == 3 else set())
    for region, chosen in asked.regions.items():
        np.testing.assert_array_equal(asked.points[chosen], part_of(place, gaps, reading, region))


def test_of_a_large_region_some_are_scored_and_the_same_ones_each_time(box, monkeypatch):
    gaps = random_gaps(box.fit, 1.5, box.resolution_m, 0)
    every = gap_case(box, gaps).asked["voxels"]
    monkeypatch.setattr(cases, "MOST_SCORED", 300)
    some, again = (gap_case(box, gaps).asked["voxels"] for _ in range(2))
    for region in ("observed", "fitted", "gaps"):
        assert len(some.regions[region]) == min(300, len(every.regions[region]))
        np.testing.assert_array_equal(some.points[some.regions[region]], again.points[again.regions[region]])
        whole = {tuple(point) for point in every.points[every.regions[region]]}
        assert {tuple(point) for point in some.points[some.regions[region]]} <= whole
    near, above = (set(some.regions[f"gaps-{side}-ground"].tolist()) for side in ("near", "above"))
    assert near | above == set(some.regions["gaps"].tolist()) and not near & above


def test_above_ground_is_higher_than_forty_centimetres(box):
    asked = gap_case(box, random_gaps(box.fit, 1.5, box.resolution_m, 0)).asked["points"]
    above = box.ground.height_above(asked.points) > 0.4
    for region in ("observed", "gaps"):
        chosen = asked.regions[region]
        np.testing.assert_array_equal(asked.regions[f"{region}-above-ground"], chosen[above[chosen]])


def test_a_fine_map_has_cells_half_as_large_as_voxels(place):
    """Of what fitted beams saw outside the gaps, or of what those of scans that are kept saw."""
    res, gaps = place.resolution_m, random_gaps(place.fit, 1.2, place.resolution_m, 0)
    shown = [(gap_case(place, gaps, "fine-map"), place.scans, gaps.cut)]
    for region, kept in occluded_parts(place.scans, 0).items():
        shown.append((occlusion_case(place, region, kept, "fine-map"), place.scans.select(kept), lambda cells: cells))
    for case, scans, cut in shown:
        cells = cut(voxel_cloud(scans.select(~scans.held_out()), res / 2))
        expected = cloud_of_cells(cells.points, cells.occupied, res / 2, res)
        for name in ("points", "occupied", "weight"):
            np.testing.assert_array_equal(getattr(case.shown, name), getattr(expected, name))
        assert len(cells) > 1.5 * len(cut(voxel_cloud(scans.select(~scans.held_out()), res)))
