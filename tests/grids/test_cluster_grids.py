from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.clusters.starts import STARTS
from hilbertvae.grids.aligned_grid import FREE, OCCUPIED, UNKNOWN, IndexedCloud, bin_places, bin_points, count_code
from hilbertvae.grids.cluster_grids import GridSettings, bin_grids, bin_shown, bin_voted, find_frames, labels_of, voxel_grid
from toy_rooms import tiny_grid


def test_cells_of_an_aligned_box_are_the_voxels_of_the_map(place):
    """The default grid read at a voxel's centre is that voxel's label in the `voxels` cloud: one rule, one lattice."""
    settings = tiny_grid(place.dimension)
    frames = find_frames(place.whole, settings, seed=0)
    grids = bin_grids(place.whole, frames, settings)
    assert grids.shape == (len(frames), *(16,) * place.dimension) and grids.dtype == np.int8
    label = {
        tuple(np.round(p, 6)): OCCUPIED if occupied else FREE
        for p, occupied in zip(place.voxels.points, place.voxels.occupied, strict=True)
    }
    low, _ = frames.boxes()
    for m in range(0, len(frames), 7):
        for cell in np.ndindex(*(16,) * place.dimension):
            centre = low[m] + (np.array(cell) + 0.5) * place.resolution_m
            assert grids[m][cell] == label.get(tuple(np.round(centre, 6) + 0.0), UNKNOWN)


def test_clusters_with_few_returns_make_no_grid(room):
    few, many = (find_frames(room.fit, replace(tiny_grid(), minimum_points=least), seed=0) for least in (1, 35))
    assert 0 < len(many) < len(few)
    assert len(find_frames(room.fit, replace(tiny_grid(), minimum_points=10**6), seed=0)) == 0


@pytest.mark.parametrize("start", STARTS)
def test_every_start_makes_grids_of_clusters_with_enough_returns(start, place):
    settings = replace(tiny_grid(place.dimension), start=start, minimum_points=5)
    frames = find_frames(place.fit, settings, seed=0)
    fewer = find_frames(place.fit, replace(settings, minimum_points=120), seed=0)
    assert len(fewer) < len(frames) and frames.scale[0] == settings.cluster_diameter_m
    assert (bin_grids(place.fit, frames, settings) == OCCUPIED).any(axis=tuple(range(1, place.dimension + 1))).all()


def test_the_start_is_quick_means_unless_chosen(room):
    chosen = {start: find_frames(room.fit, replace(tiny_grid(), start=start), seed=0).centre for start in STARTS}
    np.testing.assert_array_equal(find_frames(room.fit, tiny_grid(), seed=0).centre, chosen["quick_means"])
    assert len({centre.tobytes() for centre in chosen.values()}) == len(STARTS)


def test_only_free_points_make_no_clusters():
    with pytest.raises(InputError, match="expected occupied points to cluster, got none"):
        find_frames(Cloud(np.ones((3, 2)), np.zeros(3, bool), np.ones(3)), tiny_grid(), seed=0)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cells", 1),
        ("cluster_diameter_m", 0.0),
        ("inner_radius_m", -1.0),
        ("inner_radius_m", 3.3),
        ("occupied_share", 0.0),
        ("occupied_share", 1.1),
        ("occupied_share", None),
        ("start", ["random"]),
        ("start", "forgy"),
    ],
)
def test_settings_that_make_no_grid_are_named(key, value):
    GridSettings().check()
    with pytest.raises(InputError, match=f"grid.{key}: expected"):
        replace(GridSettings(), **{key: value}).check()


def test_details_are_labels_counts_and_places(place):
    grid = tiny_grid(place.dimension)
    frames = find_frames(place.fit, grid, 0)
    found = bin_shown(place.fit, frames, grid, detailed=True)
    hits, frees = bin_points(place.fit, frames, grid.cells)
    np.testing.assert_array_equal(labels_of(found, place.dimension), bin_shown(place.fit, frames, grid, detailed=False))
    np.testing.assert_array_equal(found[:, 1], count_code(hits))
    np.testing.assert_array_equal(found[:, 2], count_code(frees))
    np.testing.assert_array_equal(found[:, 3:], bin_places(place.fit.select(place.fit.occupied), frames, grid.cells))
    assert found.dtype == np.int8 and found[:, 3:].any()
    assert (found[:, 0][found[:, 1] > 0] != UNKNOWN).all()


@pytest.mark.parametrize("detailed", [False, True])
def test_a_cloud_that_was_sorted_once_gives_the_same_grids(place, detailed):
    """To the bit, for some of the boxes after the other, too."""
    grid = tiny_grid(place.dimension)
    frames = find_frames(place.fit, grid, 0)
    indexed = IndexedCloud.around(place.fit, frames)
    found = [bin_shown(indexed, frames.select(slice(start, start + 3)), grid, detailed) for start in range(0, len(frames), 3)]
    np.testing.assert_array_equal(np.concatenate(found), bin_shown(place.fit, frames, grid, detailed))


@pytest.mark.parametrize(("resolution_m", "cells"), [(0.05, 128), (0.1, 64), (0.15, 42), (0.2, 32), (5.0, 2)])
def test_cells_of_voxels(resolution_m, cells):
    """With 0.1 m it is the default."""
    grid = voxel_grid(resolution_m)
    grid.check()
    assert grid.cells == cells and grid.cell_m == pytest.approx(resolution_m)
    assert (grid == GridSettings()) == (resolution_m == 0.1)


def test_votes_are_hits_and_a_share_of_frees(place):
    grid, cloud = tiny_grid(place.dimension), place.fit
    frames = find_frames(cloud, grid, 0)
    hits, frees = bin_points(cloud, frames, grid.cells)
    found = bin_voted(cloud, frames, grid, 0.25)
    np.testing.assert_array_equal(found[:, 0], bin_grids(cloud, frames, grid))
    np.testing.assert_array_equal(found[:, 1], count_code(hits + 0.25 * frees))


def test_a_known_cell_has_votes_however_few(place):
    """A free sample of small voxels is a small share of a vote; of a code of 0 nothing would be learned."""
    grid, cloud = tiny_grid(place.dimension), place.fit
    labels, votes = bin_voted(cloud, find_frames(cloud, grid, 0), grid, 0.01).swapaxes(0, 1)
    np.testing.assert_array_equal(votes > 0, labels != UNKNOWN)
    assert (votes == 1).any()
