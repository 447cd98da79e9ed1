"""`.ot` and `.bt`: there and back, between us and octomap, and files that are damaged or forged."""

import subprocess
import sys
import tracemalloc

import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.commands.query import main as query
from hilbertvae.mappers.octomap_mapper import OctoMapMapper, read_octree, write_octree
from hilbertvae.mappers.saved_map import load_map


def solid_room(dimension, offset_m=0.0):
    """A fitted map with a block of equal voxels, which in 3D is pruned."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 6, (600, dimension)) - 1.3
    occupied, weight = (points[:, :2] < -1.1).any(axis=1), rng.integers(1, 13, 600).astype(float)
    block = np.stack(np.meshgrid(*[np.arange(8) * 0.2 + 6.5] * dimension), axis=-1).reshape(-1, dimension)
    cloud = np.concatenate([points, block]), np.append(occupied, np.ones(len(block), bool)), np.append(weight, np.full(len(block), 99.0))
    return OctoMapMapper(0.2).fit(cloud[0] + offset_m, *cloud[1:]), cloud[0] + offset_m


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("offset_m", [0.0, 4.5e6])
def test_round_trips(dimension, offset_m, tmp_path):
    mapper, points = solid_room(dimension, offset_m)
    assert (mapper.leaves_.depth < 16).any() == (dimension == 3)
    queries = np.concatenate([points, np.random.default_rng(1).uniform(-2, 9, (500, dimension)) + offset_m])
    answers = mapper.predict_proba(queries)[:, 1]
    for ending, expected in ((".ot", answers), (".bt", np.where(answers == 0.5, 0.5, np.where(answers > 0.5, 0.971, 0.1192)))):
        path = tmp_path / f"map{ending}"
        write_octree(mapper, path)
        read = read_octree(path)
        np.testing.assert_allclose(read.predict_proba(queries)[:, 1], expected, rtol=0, atol=0 if ending == ".ot" else 1e-7)
        np.testing.assert_array_equal(read.observed(queries), mapper.observed(queries))
        assert (read.n_features_in_, read.resolution_m) == (dimension, 0.2)
        write_octree(read, tmp_path / f"again{ending}")
        assert (tmp_path / f"again{ending}").read_bytes() == path.read_bytes()
        assert read.fit(points, np.arange(len(points)) % 2 == 0).predict_proba(queries).shape == (len(queries), 2)


def test_octomap_reads_what_we_write_and_we_what_it_writes(tmp_path):
    mapper, points = solid_room(3)
    for ending in (".ot", ".bt"):
        write_octree(mapper, tmp_path / f"ours{ending}")
    tree, binary = octomap.OcTree.read(str(tmp_path / "ours.ot")), octomap.OcTree(1.0)
    assert binary.readBinary(str(tmp_path / "ours.bt")) and binary.getResolution() == tree.getResolution() == 0.2
    assert tree.write() == mapper.tree().write()
    labels = np.where(mapper.predict_proba(points)[:, 1] > 0.5, 1, 0)
    np.testing.assert_array_equal(tree.getLabels(points), labels)
    np.testing.assert_array_equal(binary.getLabels(points), labels)
    assert tree.write(str(tmp_path / "theirs.ot")) and tree.writeBinary(str(tmp_path / "theirs.bt"))
    np.testing.assert_array_equal(read_octree(tmp_path / "theirs.ot").predict_proba(points), mapper.predict_proba(points))
    np.testing.assert_array_equal(read_octree(tmp_path / "theirs.bt").predict(points), labels)


def test_all_digits_of_the_resolution_are_kept(tmp_path):
    mapper = OctoMapMapper(1 / 3).fit([[0.0, 0.0], [1.0, 2.0]], [False, True])
    for ending in (".ot", ".bt"):
        write_octree(mapper, tmp_path / f"map{ending}")
        assert read_octree(tmp_path / f"map{ending}").resolution_ == 1 / 3


def test_one_label_everywhere(tmp_path):
    """A tree that is one leaf, which only a forged file is: `.bt` has no word for it, but has one for eight children."""
    leaf = np.float32(1).tobytes() + b"\0"
    for nodes in (leaf, leaf[:4] + b"\xff" + 8 * leaf):
        (tmp_path / "map.ot").write_bytes(b"# Octomap OcTree file\nid OcTree\nsize %d\nres 0.1\ndata\n" % (len(nodes) // 5) + nodes)
        mapper = read_octree(tmp_path / "map.ot")
        assert mapper.predict([[-3000.0, 0, 3000]]) == [True]
        if len(mapper.leaves_) == 1:
            with pytest.raises(InputError, match="map.bt: .*one label everywhere"):
                write_octree(mapper, tmp_path / "map.bt")
        else:
            write_octree(mapper, tmp_path / "map.bt")
            assert read_octree(tmp_path / "map.bt").predict([[-3000.0, 0, 3000]]) == [True]


def test_an_empty_map_is_unknown(tmp_path):
    assert octomap.OcTree(0.1).write(str(tmp_path / "empty.ot"))
    mapper = read_octree(tmp_path / "empty.ot")
    np.testing.assert_array_equal(mapper.predict_proba([[0.0, 0.0, 0.0]]), [[0.5, 0.5]])
    write_octree(mapper, tmp_path / "empty.bt")
    assert len(read_octree(tmp_path / "empty.bt").leaves_) == 0


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a small map, by ending."""
    folder, found = tmp_path_factory.mktemp("files"), {}
    mapper, _ = solid_room(3)
    for ending in (".ot", ".bt"):
        write_octree(mapper, folder / f"map{ending}")
        found[ending] = (folder / f"map{ending}").read_bytes()
    return found


@pytest.mark.parametrize("ending", [".ot", ".bt"])
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"# Octomap", b"# OctoNap", "first line"),
        (b"file\n", b"file of mine\n", "first line"),
        (b"id OcTree", b"id ColorOcTree", "id OcTree"),
        (b"id OcTree\n", b"", "id OcTree"),
        (b"size ", b"size 1", "size: expected 1"),
        (b"size ", b"size " + b"9" * 5000, "size: expected 9"),
        (b"size ", b"sighs ", "size: expected None"),
        (b"res 0.2", b"res 0", "res: expected a positive number"),
        (b"res 0.2", b"res 1e308", "res: expected from 0.0001 to 10000 metres"),
        (b"res 0.2", b"res nan", "res: expected a positive number"),
        (b"res 0.2", b"res wide", "expected a number, got 'wide'"),
        (b"res 0.2\n", b"", "expected a number, got 'None'"),
        (b"\ndata\n", b"\ndata", "line 'data'"),
        (b"\ndata\n", b"\n" + b"#" * 70_000 + b"\ndata\n", "line 'data'"),
        (b"voxels 0 0 0", b"voxels 0", "2 or 3 whole numbers"),
        (b"voxels 0 0 0", b"voxels 0 0 0.5", "2 or 3 whole numbers"),
        (b"voxels 0 0 0", b"voxels 0 0 inf", "2 or 3 whole numbers"),
        (b"voxels 0 0 0", b"voxels 0 0 up", "expected a number, got 'up'"),
    ],
)
def test_forged_headers_are_refused(files, ending, old, new, message, tmp_path):
    path = tmp_path / f"forged{ending}"
    assert old in files[ending]
    path.write_bytes(files[ending].replace(old, new, 1))
    with pytest.raises(InputError, match=f"forged{ending}: .*{message}"):
        read_octree(path)


def test_bad_paths_are_refused(files, tmp_path):
    for path in (tmp_path / "none.ot", tmp_path):
        with pytest.raises(InputError, match=f"{path.name}: expected an OctoMap file, found none"):
            read_octree(path)
    (tmp_path / "empty.bt").touch()
    with pytest.raises(InputError, match="empty.bt: expected an OctoMap header"):
        read_octree(tmp_path / "empty.bt")
    with pytest.raises(InputError, match="ends in .ot or .bt"):
        write_octree(solid_room(2)[0], tmp_path / "map.ply")


@settings(max_examples=150)
@given(ending=st.sampled_from([".ot", ".bt"]), data=st.data())
def test_damaged_files_are_refused_or_read_in_little_memory(files, ending, data, tmp_path_factory):
    content = bytearray(files[ending])
    header = content.index(b"\ndata\n") + 6
    kind = data.draw(st.sampled_from(["bytes", "header", "cut", "repeat", "replace"]))
    place = data.draw(st.integers(0 if kind in ("header", "cut") else header, (header if kind == "header" else len(content)) - 1))
    if kind in ("bytes", "header"):
        content[place] = data.draw(st.integers(0, 255))
    elif kind == "cut":
        del content[place : place + data.draw(st.integers(1, 50))]
    elif kind == "repeat":
        content[place:place] = content[place : place + 50] * data.draw(st.integers(1, 30))
    else:
        content[place:] = data.draw(st.sampled_from([b"\xff", b"\x00", b"\x03\x00", b"\x00\x00\x00\x00\xff"])) * 20_000
    path = tmp_path_factory.mktemp("damaged") / f"map{ending}"
    path.write_bytes(content)
    tracemalloc.start()
    try:
        mapper = read_octree(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    finally:
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 200 * len(content) + 1_000_000
    queries = np.random.default_rng(0).uniform(-2, 9, (50, mapper.n_features_in_))
    probability = mapper.predict_proba(queries)
    assert ((probability >= 0) & (probability <= 1)).all()
    assert mapper.tree().getNumLeafNodes() == len(mapper.leaves_)


def test_files_that_end_octomaps_own_reader_do_not_end_ours(files, tmp_path):
    """Child masks all set, which C++ follows until memory or stack is gone, read by a process that may take 3 GB."""
    paths = []
    for ending, content in files.items():
        paths.append(tmp_path / f"deep{ending}")
        paths[-1].write_bytes(content[: content.index(b"\ndata\n") + 6] + b"\xff\xff\x00\x00\xff" * 400_000)
    program = """
import resource, sys
from hilbertvae.checks import InputError
from hilbertvae.mappers.octomap_mapper import read_octree
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
for path in sys.argv[1:]:
    try:
        read_octree(path)
    except InputError:
        print("refused")
"""
    done = subprocess.run([sys.executable, "-c", program, *map(str, paths)], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.split()) == (0, ["refused"] * 2), done.stderr


def test_load_map_and_the_query_command_read_it(tmp_path, capsys):
    mapper, points = solid_room(3)
    write_octree(mapper, tmp_path / "map.ot")
    np.savetxt(tmp_path / "asked.txt", points[:5])
    answers = load_map(tmp_path / "map.ot").predict_map(points[:5])
    assert query([f"map={tmp_path / 'map.ot'}", f"points={tmp_path / 'asked.txt'}"]) == 0
    said = [line.split(",") for line in capsys.readouterr().out.splitlines()[1:]]
    np.testing.assert_allclose([float(line[3]) for line in said], answers, atol=6e-5)
    assert {line[4] for line in said} == {"nan"} and {line[5] for line in said} == {"1"}
