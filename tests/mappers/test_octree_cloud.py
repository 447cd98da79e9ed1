import tracemalloc

import numpy as np
import octomap
import pytest

from hilbertvae.checks import InputError
from hilbertvae.mappers.octomap_mapper import OctoMapMapper, read_octree
from hilbertvae.mappers.octree import DEPTH, SIDE, Leaves, morton, morton_keys
from hilbertvae.mappers.octree_cloud import octree_cloud


def test_codes_go_back_to_keys():
    keys = np.random.default_rng(0).integers(0, SIDE, (1000, 3))
    keys[:4] = [[0, 0, 0], [SIDE - 1] * 3, [1, 0, SIDE - 1], [SIDE // 2] * 3]
    np.testing.assert_array_equal(morton_keys(morton(keys)), keys)


def test_leaves_are_taken_apart():
    leaves = Leaves(np.array([0, 64, 72, 73]), np.array([14, 15, 16, 16], np.int8), np.zeros(4, np.float32))
    code, leaf = leaves.voxels()
    np.testing.assert_array_equal(code, np.arange(74))
    np.testing.assert_array_equal(leaf, [0] * 64 + [1] * 8 + [2, 3])
    assert leaves.voxel_count() == 74
    assert Leaves(np.zeros(1, np.int64), np.zeros(1, np.int8), np.zeros(1, np.float32)).voxel_count() == 2**48


@pytest.mark.parametrize("ending", [".ot", ".bt"])
def test_a_map_of_octomaps_own_with_pruned_leaves(tmp_path, ending):
    tree, expected = octomap.OcTree(0.2), {}
    for index in np.ndindex(9, 9, 9):
        voxel = np.array(index) - 4
        occupied = bool(voxel[2] < -1)
        for _ in range(20):  # to the clamp, so that equal siblings are joined
            tree.updateNode((voxel + 0.5) * 0.2, occupied)
        expected[tuple(voxel.tolist())] = occupied
    if ending == ".ot":
        tree.write(str(tmp_path / "theirs.ot"))
    else:
        tree.writeBinary(str(tmp_path / "theirs.bt"))
    mapper = read_octree(tmp_path / f"theirs{ending}")
    assert (mapper.leaves_.depth < DEPTH).any()
    cloud = octree_cloud(mapper)
    index = np.floor(cloud.points / 0.2).astype(int)
    assert dict(zip(map(tuple, index.tolist()), cloud.occupied.tolist(), strict=True)) == expected and len(cloud) == len(expected)
    np.testing.assert_allclose(cloud.points, (index + 0.5) * 0.2)
    assert len(octree_cloud(mapper, 0.1)) == 8 * len(cloud)


@pytest.mark.parametrize("ending", [".ot", ".bt"])
def test_what_beams_graze_is_what_octomap_says_it_is(tmp_path, ending):
    """By log-odds of 0.847 per hit and -0.405 per miss: of a hit and two misses 0.51, with three 0.41, and 0.5 as it was written."""
    tree = octomap.OcTree(1.0)
    for x, votes in enumerate([[True], [False], [True, False, False], [True, False, False, False]]):
        for vote in votes:
            tree.updateNode(np.array([x + 0.5, 0.5, 0.5]), vote)
    tree.updateNode(np.array([4.5, 0.5, 0.5]), 0.0)
    assert 0.5 < tree.search(np.array([2.5, 0.5, 0.5])).getOccupancy() < 0.6
    theirs = {x + 0.5: bool(tree.isNodeOccupied(tree.search(np.array([x + 0.5, 0.5, 0.5])))) for x in range(5)}
    tree.write(str(tmp_path / "theirs.ot"))
    tree.writeBinary(str(tmp_path / "theirs.bt"))
    cloud = octree_cloud(read_octree(tmp_path / f"theirs{ending}"))
    assert dict(zip(cloud.points[:, 0].tolist(), cloud.occupied.tolist(), strict=True)) == theirs
    assert theirs == {0.5: True, 1.5: False, 2.5: True, 3.5: False, 4.5: True}


@pytest.mark.parametrize("offset_m", [0.0, 4.5e6])
@pytest.mark.parametrize("dimension", [2, 3])
def test_fitted_voxels_come_back(dimension, offset_m):
    points = np.random.default_rng(1).uniform(-3, 3, (300, dimension)) + offset_m
    mapper = OctoMapMapper(0.2).fit(points, points[:, 0] > offset_m, np.full(300, 9.0))
    cloud = octree_cloud(mapper)
    expected = set(map(tuple, np.floor(points / 0.2).astype(int).tolist()))
    assert set(map(tuple, np.floor(cloud.points / 0.2).astype(int).tolist())) == expected and len(cloud) == len(expected)
    np.testing.assert_array_equal(mapper.predict(cloud.points), cloud.occupied)


def test_a_leaf_near_the_root_takes_no_memory(tmp_path):
    node = np.float32(1).tobytes() + b"\0"
    (tmp_path / "root.ot").write_bytes(b"# Octomap OcTree file\nid OcTree\nsize 1\nres 0.1\ndata\n" + node)
    mapper = read_octree(tmp_path / "root.ot")
    tracemalloc.start()
    with pytest.raises(InputError, match=f"got {2**48} of 0.1 m"):
        octree_cloud(mapper)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_an_empty_map_is_refused(tmp_path):
    assert octomap.OcTree(0.1).write(str(tmp_path / "empty.ot"))
    with pytest.raises(InputError, match="expected 1 to .* got 0"):
        octree_cloud(read_octree(tmp_path / "empty.ot"))
