"""Real occlusion: which scans are kept, and which places are scored."""

from dataclasses import replace

import numpy as np
import pytest
from protocol_toys import Spy, voxels
from scipy.spatial import cKDTree

from hilbertvae.cloud import fit_cloud
from hilbertvae.mappers.constant import ConstantMapper
from hilbertvae.scoring import cases
from hilbertvae.scoring.cases import occluded_parts, occlusion_case
from hilbertvae.scoring.metrics import score
from hilbertvae.scoring.protocol import Protocol, evaluate
from hilbertvae.site import Site
from hilbertvae.voxel_votes import voxel_index
from toy_rooms import box_room, square_room


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def near_sighted(request):
    """A site of which no scan sees more than 3 m, so that what is left out is truly hidden."""
    scans = square_room() if request.param == 2 else box_room()
    return Site("near-sighted", scans.select(np.linalg.norm(scans.points - scans.origins, axis=1) < 3.0))


def test_which_scans_occlusion_keeps(near_sighted):
    scans = near_sighted.scans
    step = {2: 10, 3: 3}[near_sighted.dimension]
    count = scans.scan.max() + 1
    for seed in (0, 4):
        parts = occluded_parts(scans, seed)
        for scan in range(count):
            mine = scans.scan == scan
            assert (parts["occluded-sparse"][mine] == ((scan - seed) % step == 0)).all()
            assert (parts["occluded-half"][mine] == (scan < count / 2)).all()


@pytest.mark.parametrize(("count", "kept"), [(1, set()), (2, {"occluded-half"}), (3, {"occluded-half", "occluded-sparse"})])
def test_a_site_of_few_scans_keeps_its_other_scores(count, kept):
    whole = box_room()
    scans = whole.select(whole.scan < count)
    assert set(scans.scan) == set(range(count))
    protocol = Protocol(gap_seeds=[0, 1, 2], gap_ratio=0.5, cluster_size_m=2.0)
    found = evaluate(ConstantMapper(), Site("few", scans), protocol, "all").scores["all"]["voxels"]
    assert {name for name in found if name in ("occluded-half", "occluded-sparse")} == kept
    assert all(len(values) == 3 for region in found.values() for values in region.values())


def test_a_setting_that_would_keep_no_return_is_left_out_for_every_seed():
    """A scan that returned nothing has a number and no points."""
    whole = square_room()
    scans = whole.select((whole.scan < 12) & (whole.scan % 10 != 3))
    for seed in (0, 3):
        assert set(occluded_parts(scans, seed)) == {"occluded-half"}
    late = whole.scan > whole.scan.max() / 2
    silent = whole.select(late | (whole.scan == 0) & whole.held_out())  # of whose first half nothing is shown
    assert set(occluded_parts(silent, 0)) == {"occluded-sparse"}


def test_scans_may_be_numbered_from_anywhere():
    """A drive that was cut out of a longer one is itself a drive, with a first half."""
    whole = square_room()
    later = replace(whole, scan=whole.scan + 10)
    for seed in (0, 4):
        before, after = (occluded_parts(scans, seed) for scans in (whole, later))
        assert set(before) == set(after) == {"occluded-sparse", "occluded-half"}
        for region in before:
            np.testing.assert_array_equal(before[region], after[region])


def test_occlusion_by_brute_force(near_sighted):
    """Scored is what only the left-out scans saw, by its distance from the nearest kept point; shown is what the kept ones saw."""
    site = near_sighted
    spy = Spy()
    found = evaluate(spy, site, Protocol(gap_seeds=[4], gap_ratio=0.5, cluster_size_m=3.0), "spy").scores["spy"]["voxels"]
    assert len(spy.fits_) == 3
    held_out = site.scans.held_out()
    for (region, kept), given in zip(occluded_parts(site.scans, 4).items(), spy.fits_[1:], strict=True):
        expected = fit_cloud(site.scans.select(kept & ~held_out), site.resolution_m)
        np.testing.assert_array_equal(given[0], expected.points)
        seen = fit_cloud(site.scans.select(kept), site.resolution_m)
        known = voxels(seen.points, site.resolution_m)
        bands = {(0.5, 2.5): region, (0.25, 0.5): f"{region}-0.25-0.5", (0.5, 1.0): f"{region}-0.5-1", (1.0, 2.5): f"{region}-1-2.5"}
        inside = {band: [] for band in bands}
        for k, index in enumerate(voxel_index(site.voxels.points, site.resolution_m).tolist()):
            if tuple(index) in known:
                continue
            away = np.sqrt(((seen.points - site.voxels.points[k]) ** 2).sum(axis=1).min())
            for band in bands:
                if band[0] <= away < band[1]:
                    inside[band].append(k)
        assert len(inside[0.5, 2.5]) > 20
        tree = cKDTree(given[0])
        for band, row in bands.items():
            chosen = np.array(inside[band], int)
            distance, nearest = tree.query(site.voxels.points[chosen])
            answer = np.where(distance < 0.15, given[1][nearest], 0.5)
            for metric, value in score(site.voxels.occupied[chosen], answer).items():
                assert found[row][metric] == [pytest.approx(value, abs=1e-12)], (row, metric)


def test_of_a_large_region_some_are_scored_in_their_bands(near_sighted, monkeypatch):
    region, kept = next(iter(occluded_parts(near_sighted.scans, 4).items()))
    every = occlusion_case(near_sighted, region, kept).asked["voxels"]
    most = len(every.points) // 3
    monkeypatch.setattr(cases, "MOST_SCORED", most)
    some = occlusion_case(near_sighted, region, kept).asked["voxels"]
    scored = {tuple(point) for point in some.points}
    assert len(scored) == most
    for row, chosen in every.regions.items():
        assert {tuple(point) for point in some.points[some.regions[row]]} == {tuple(point) for point in every.points[chosen]} & scored
