from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud, placed_as, voxel_cloud
from hilbertvae.gaps import OUTSIDE, NoRoom, random_gaps
from hilbertvae.grids import training_grids as made_by
from hilbertvae.grids.aligned_grid import count_code
from hilbertvae.grids.cluster_grids import bin_detailed, bin_grids, find_frames
from hilbertvae.grids.frame import FrameSettings
from hilbertvae.grids.training_grids import ClusteringSettings, gapped_grids, training_grids, turned
from hilbertvae.observed_map import CELL_WEIGHT, cloud_of_cells
from hilbertvae.occlusions import random_occlusion
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_votes import voxel_index
from toy_rooms import tiny_grid


def test_turning_keeps_heights_and_distances(place):
    scans, moved = place.scans, turned(place.scans, 0.5)
    np.testing.assert_allclose(
        np.linalg.norm(moved.points - moved.origins, axis=1), np.linalg.norm(scans.points - scans.origins, axis=1), atol=1e-9
    )
    x, y = scans.points[:, 0], scans.points[:, 1]
    np.testing.assert_allclose(moved.points[:, 0], x * np.cos(0.5) - y * np.sin(0.5), atol=1e-9)
    np.testing.assert_allclose(moved.points[:, 1], x * np.sin(0.5) + y * np.cos(0.5), atol=1e-9)
    np.testing.assert_array_equal(moved.points[:, 2:], scans.points[:, 2:])
    np.testing.assert_array_equal(moved.scan, scans.scan)


@pytest.mark.parametrize("seed", [0, 5])
def test_a_clustering_cuts_its_gaps_before_anything_else(place, seed):
    """What the input lacks is in a gap, and the frames are those of the gapped site; the target is uncut, in the same frames."""
    grid, clustering = tiny_grid(place.dimension), ClusteringSettings(1, [1.0, 1.5], turn=False)
    shown, target = training_grids(place.scans, place.resolution_m, grid, clustering, seed)
    whole = fit_cloud(place.scans, place.resolution_m)
    gaps = random_gaps(whole, (1.0, 1.5), place.resolution_m, seed)
    left = whole.select(gaps.part(whole.points) == OUTSIDE)
    frames = find_frames(left, grid, seed)
    np.testing.assert_array_equal(shown, bin_grids(left, frames, grid))
    np.testing.assert_array_equal(target, bin_grids(whole, frames, grid))
    assert shown.shape == target.shape and shown.dtype == target.dtype == np.int8
    removed = (shown == 0) & (target != 0)
    assert removed.any() and (shown[~removed] == target[~removed]).all()


def test_without_gaps_the_input_is_the_target(room):
    shown, target = training_grids(room.scans, 0.1, tiny_grid(), ClusteringSettings(1, [], turn=True), seed=3)
    np.testing.assert_array_equal(shown, target)


def test_turning_moves_what_boxes_see(room):
    def target(seed, turn):
        return training_grids(room.scans, 0.1, tiny_grid(), ClusteringSettings(1, [], turn=turn), seed)[1]

    straight, oblique = target(4, False), target(4, True)
    assert straight.shape != oblique.shape or (straight != oblique).any()
    np.testing.assert_array_equal(target(4, True), oblique)


def test_an_occluded_clustering_is_shown_fewer_scans(place):
    grid, clustering = tiny_grid(place.dimension), ClusteringSettings(1, [1.0, 1.5], occluded_share=1.0, turn=False)
    shown, target = training_grids(place.scans, place.resolution_m, grid, clustering, 3)
    left = fit_cloud(place.scans.select(random_occlusion(place.scans, 3)), place.resolution_m)
    frames = find_frames(left, grid, 3)
    np.testing.assert_array_equal(shown, bin_grids(left, frames, grid))
    whole = placed_as(fit_cloud(place.scans, place.resolution_m), left, place.resolution_m)
    np.testing.assert_array_equal(target, bin_grids(whole, frames, grid))
    assert ((shown == 0) & (target != 0)).any() and ((shown == 0) | (target != 0)).all()


def test_what_an_occlusion_hides_is_in_voxels_that_it_left_unseen(room):
    """In turned boxes, too, of grids as fine as voxels: but for cells whose middle lies in another voxel than what is in them."""
    grid, hidden, of_seen = replace(tiny_grid(), frame=FrameSettings(rotation="spread")), 0, 0
    for seed in range(6):
        shown, target = training_grids(room.scans, 0.1, grid, ClusteringSettings(1, [], occluded_share=1.0, turn=False), seed)
        left = fit_cloud(room.scans.select(random_occlusion(room.scans, seed)), 0.1)
        seen = set(map(tuple, voxel_index(left.points, 0.1)))
        frames = find_frames(left, grid, seed)
        m, *cell = np.nonzero((shown == 0) & (target != 0))
        middles = frames.back((np.stack(cell, axis=1) + 0.5) / grid.cells - 0.5, m)
        hidden += len(m)
        of_seen += sum(tuple(voxel) in seen for voxel in voxel_index(middles, 0.1))
    assert hidden > 100 and of_seen < 0.15 * hidden


def test_as_many_clusterings_are_occluded_as_asked(room, monkeypatch):
    asked = []
    monkeypatch.setattr(made_by, "random_occlusion", lambda scans, seed: asked.append(seed) or np.ones(len(scans), bool))
    for seed in range(20):
        training_grids(room.scans, 0.1, tiny_grid(), ClusteringSettings(1, [0.6, 1.0], occluded_share=0.5, turn=False), seed)
    assert 4 <= len(asked) <= 16


@pytest.mark.parametrize("occluded", [0.0, 1.0])
def test_a_mapped_clustering_is_shown_what_a_map_would_say(place, occluded):
    """Cells with one label each, whatever their votes and where these lie; the target is still all that scans know. Cells are as large as
    voxels or half as large, and these are read in voxels of their own, or not."""
    grid, res = replace(tiny_grid(place.dimension), frame=FrameSettings(rotation="spread")), place.resolution_m
    how = ClusteringSettings(1, [1.0, 1.5], occluded, mapped_share=1.0, turn=False)
    whole, kinds = fit_cloud(place.scans, res), [(1, 1), (2, 1), (2, 2)]
    found = set()
    for seed in range(3, 9):
        shown, target = training_grids(place.scans, res, grid, how, seed, detailed=True)
        seen = place.scans.select(random_occlusion(place.scans, seed)) if occluded else place.scans
        cut = (lambda cells: cells) if occluded else random_gaps(whole, (1.0, 1.5), res, seed).cut
        for parts, per_voxel in kinds:
            cells = cut(voxel_cloud(seen, res / parts))
            read = cloud_of_cells(cells.points, cells.occupied, res / parts, res / per_voxel)
            frames = find_frames(read, grid, seed)
            if len(frames) == len(shown) and np.array_equal(bin_detailed(read, frames, grid), shown):
                found.add((parts, per_voxel))
                np.testing.assert_array_equal(target, bin_grids(placed_as(whole, cut(voxel_cloud(seen, res)), res), frames, grid))
                break
        else:
            raise AssertionError(f"seed {seed}: shows what no map says")
        known = shown[:, 0] != 0
        assert known.any() and (target[known] != 0).mean() > 0.5 and ((target != 0) & ~known).any()
        most = CELL_WEIGHT * (2 * per_voxel) ** place.dimension  # of a turned box's cell, at most the points of so many voxels
        assert shown[:, 1:3].max() <= count_code(np.array([most]))[0]
    assert len(found) > 1


def test_as_many_clusterings_are_mapped_as_asked(room, monkeypatch):
    asked, made = [], made_by.map_of
    monkeypatch.setattr(made_by, "map_of", lambda *shown: asked.append(shown) or made(*shown))
    for seed in range(20):
        training_grids(room.scans, 0.1, tiny_grid(), ClusteringSettings(1, [0.6, 1.0], mapped_share=0.5, turn=False), seed)
    assert 4 <= len(asked) <= 16


@pytest.mark.parametrize("key", ["occluded_share", "mapped_share"])
def test_a_share_is_between_0_and_1(key):
    with pytest.raises(InputError, match=rf"clustering.{key}: expected a share in \[0, 1\], got 1.5"):
        ClusteringSettings(**{key: 1.5})


@pytest.mark.parametrize("sizes", [2.5, "2.5", ["1", "2"], [np.nan, np.nan]])
def test_gap_diameters_are_none_or_two(sizes):
    """One number would be a size for `random_gaps`."""
    with pytest.raises(InputError, match="clustering.gap_diameter_m: expected the smallest and the largest, or an empty list, got"):
        ClusteringSettings(gap_diameter_m=sizes)
    assert ClusteringSettings(gap_diameter_m=np.array([1.5, 2.5])).gap_diameter_m == [1.5, 2.5]
    assert ClusteringSettings(gap_diameter_m=[]).gap_diameter_m == []


def test_details_are_shown_on_request(place):
    """Of what is left; the target is labels alone, as before."""
    how = place.scans, place.resolution_m, tiny_grid(place.dimension), ClusteringSettings(1, [1.0, 1.5], turn=False), 5
    shown, target = training_grids(*how, detailed=True)
    labels, expected = training_grids(*how)
    np.testing.assert_array_equal(shown[:, 0], labels)
    np.testing.assert_array_equal(target, expected)
    assert shown.shape[1] == 3 + place.dimension and not shown[:, 1:][np.broadcast_to(labels[:, None] == 0, shown[:, 1:].shape)].any()


def test_targets_say_how_many_points_are_in_each_cell(place):
    """A return is one, a free sample what it is of a free point of the `points` cloud."""
    how = place.scans, place.resolution_m, tiny_grid(place.dimension), ClusteringSettings(1, [1.0, 1.5], turn=False), 5
    shown, target = training_grids(*how, voted=True)
    expected, labels = training_grids(*how)
    np.testing.assert_array_equal(shown, expected)
    np.testing.assert_array_equal(target[:, 0], labels)
    assert ((target[:, 1] > 0) <= (labels != 0)).all() and (target[:, 1][labels == 1] > 0).all()
    counts = np.expm1(target[:, 1] / 12.0)
    whole = fit_cloud(place.scans, place.resolution_m)
    votes = np.where(whole.occupied, 1, place.resolution_m / 2) * whole.weight
    assert counts.max() <= votes.max() * 1.1 + 0.1


@pytest.mark.parametrize("mapped", [0.0, 1.0])
def test_a_site_whose_returns_are_all_in_gaps_has_no_room(mapped):
    """One short wall at the end of a hall: balls take few of all points, which lie along the beams."""
    angle = np.linspace(-0.05, 0.05, 60)
    wall = np.column_stack([np.full(60, 12.0), 12 * np.tan(angle)])
    scans = Scans(wall, np.zeros((60, 2)), np.zeros(60, np.int32), np.arange(60, dtype=np.int32))
    how, refused = ClusteringSettings(1, [1.5, 3.5], mapped_share=mapped, turn=False), 0
    for seed in range(6):
        cut = random_gaps(fit_cloud(scans, 0.1), (1.5, 3.5), 0.1, seed).cut(fit_cloud(scans, 0.1))
        if cut.occupied.any():
            training_grids(scans, 0.1, tiny_grid(), how, seed)
            continue
        refused += 1
        with pytest.raises(NoRoom, match=r"gaps of \(1.5, 3.5\) m: leave no occupied point of this site"):
            training_grids(scans, 0.1, tiny_grid(), how, seed)
        with pytest.raises(NoRoom, match="leave no occupied point of this site"):
            gapped_grids(fit_cloud(scans, 0.1), 0.1, tiny_grid(), (1.5, 3.5), seed, False, most=5)
    assert 0 < refused < 6


def test_gaps_of_a_cloud_without_scans(place):
    """As of one with scans, which is neither turned nor scanned less; of more clusters than asked for, some."""
    grid, cloud = tiny_grid(place.dimension), fit_cloud(place.scans, place.resolution_m)
    clustering = ClusteringSettings(1, [1.0, 1.5], turn=False)
    for detailed in (False, True):
        wanted = training_grids(place.scans, place.resolution_m, grid, clustering, 5, detailed)
        found = gapped_grids(cloud, place.resolution_m, grid, (1.0, 1.5), 5, detailed, most=10_000)
        for ours, theirs in zip(found, wanted, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    shown, target = gapped_grids(cloud, place.resolution_m, grid, (1.0, 1.5), 5, True, most=3)
    assert len(shown) == len(target) == 3
    for one, other in zip(shown, target, strict=True):
        assert any((one == each).all() and (other == also).all() for each, also in zip(*wanted, strict=True))
