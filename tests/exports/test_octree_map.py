"""What `write_octree_map` writes, read by octomap-python alone, and by our own reader."""

import warnings

import numpy as np
import octomap
import pytest
from export_toys import any_cells, random_cells
from hypothesis import given, settings

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.octree import write_octree_map
from hilbertvae.mappers.octomap_mapper import read_octree
from hilbertvae.mappers.octree_cloud import octree_cloud


def leaves(path):
    """{voxel: log-odds} as OctoMap's own library iterates over a file's leaves, with the shift of the header's comment."""
    if path.suffix == ".ot":
        tree = octomap.OcTree.read(str(path))
    else:
        tree = octomap.OcTree(1.0)
        assert tree.readBinary(str(path))
    (line,) = [line for line in path.read_bytes().split(b"\ndata\n")[0].decode().split("\n") if "shift_voxels" in line]
    shift = np.array(line.split()[3:], dtype=float).astype(int)
    cell_m, found = tree.getResolution(), {}
    for leaf in tree.begin_leafs():
        across = round(leaf.getSize() / cell_m)
        first = np.rint(np.array(leaf.getCoordinate()) / cell_m - across / 2).astype(int)
        for step in np.ndindex(across, across, across):
            voxel = first + step
            if len(shift) == 2:
                assert voxel[2] == 0
            found[tuple((voxel[: len(shift)] + shift).tolist())] = leaf.getValue()
    return found, cell_m


@settings(max_examples=25)
@given(cells=any_cells)
def test_octomap_reads_each_cell_in_its_place(cells, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    for ending in (".ot", ".bt"):
        assert [path.name for path in write_octree_map(cells, folder / f"map{ending}")] == [f"map{ending}", f"map_observed{ending}"]
        for name, part in (("map", np.ones(len(cells), bool)), ("map_observed", cells.observed)):
            found, cell_m = leaves(folder / f"{name}{ending}")
            assert cell_m == pytest.approx(cells.resolution_m, rel=1e-15)
            p = cells.probability
            told = part if ending == ".ot" else part & ((p > np.float32(0.6)) | (p <= np.float32(0.4 + 1e-6)))
            voxels = list(map(tuple, cells.index[told].tolist()))
            assert found.keys() == set(voxels)
            values = np.array([found[voxel] for voxel in voxels])
            if ending == ".ot":
                np.testing.assert_allclose(1 / (1 + np.exp(-values)), p[told], atol=2e-6)
            else:
                np.testing.assert_array_equal(values > 0, p[told] > 0.5)


@settings(max_examples=25)
@given(cells=any_cells)
def test_a_written_map_is_what_was_observed(cells, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    """An `.ot` also says what is open, of which OctoMap takes 0.5 and more for occupied."""
    for ending in (".ot", ".bt"):
        told = cells.observed & (cells.occupied | cells.free | (ending == ".ot"))
        expected = dict(zip(map(tuple, cells.index[told].tolist()), (cells.probability[told] >= 0.5).tolist(), strict=True))
        write_octree_map(cells, folder / f"map{ending}")
        mapper = read_octree(folder / f"map_observed{ending}")
        if not expected:
            with pytest.raises(InputError, match="got 0"):
                octree_cloud(mapper)
            continue
        cloud = octree_cloud(mapper)
        index = np.floor(cloud.points / cells.resolution_m).astype(int)
        assert dict(zip(map(tuple, index.tolist()), cloud.occupied.tolist(), strict=True)) == expected
        np.testing.assert_allclose(cloud.points, (index + 0.5) * cells.resolution_m, atol=1e-6)


def test_both_files_of_a_far_map_are_shifted_alike(tmp_path):
    """OctoMap's tools know no shift: the observed map must lie on the whole one in them."""
    cells = random_cells(3, offset_m=4.5e6, span=60)
    low = cells.index[:, 0] < np.median(cells.index[:, 0])
    cells = MapCells(cells.index, 0.1, cells.probability, cells.std, low)
    with pytest.warns(UserWarning, match=r"map.ot: OctoMap's files reach 3,277 m from the origin; add \(.*4500.*\) m to its coordinates"):
        written = write_octree_map(cells, tmp_path / "map.ot")
    lines = [path.read_bytes().split(b"\n")[1] for path in written]
    assert lines[0] == lines[1] and b"shift_voxels" in lines[0] and b" 0" not in lines[0]


def test_what_does_not_fit_is_refused_and_leaves_nothing(tmp_path):
    good = random_cells(2)
    twice = good.select(np.append(np.arange(len(good)), 0))
    far = MapCells(np.array([[0, 0, 0], [70_000, 0, 0]]), 0.2, np.ones(2), np.ones(2), np.ones(2, bool))
    for cells, name, named in (
        (good, "map.ply", "ends in .ot or .bt"),
        (good.select(np.zeros(0, int)), "map.ot", "at least one"),
        (far, "map.bt", "65536 voxels"),
        (twice, "map.ot", "each once"),
    ):
        with pytest.raises(InputError, match=named):
            write_octree_map(cells, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".ot", ".bt"])
def test_a_file_with_predicted_cells_says_so_when_it_is_read(tmp_path, ending):
    """Nothing else there tells them from observed ones."""
    cells = random_cells(3)
    assert not cells.observed.all()
    write_octree_map(cells, tmp_path / f"map{ending}")
    seen = f"map{ending}: was filled before, and what was predicted is now taken as seen; map_observed{ending} has what was"
    with pytest.warns(UserWarning, match=seen):
        read_octree(tmp_path / f"map{ending}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_octree(tmp_path / f"map_observed{ending}")
