import re
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from point_writers import POINTS, WRITERS, write_npz, write_pcd, write_text

from hilbertvae.checks import InputError
from hilbertvae.scans.point_files import READERS, read_point_file, read_points

NAMES = pytest.mark.parametrize("name", WRITERS)
APART = {"a.laz", "new.laz", "a.e57"}
"""Read in a process of their own."""


@NAMES
def test_what_was_written_is_read_back(tmp_path, name):
    found = read_points(WRITERS[name](tmp_path / name))
    assert found.points.dtype == np.float64 and found.origins is None and found.scan is None
    rounding = 0.0006 if name.endswith((".las", ".laz")) else {"ascii.ply": 1e-7, "ascii.pcd": 1e-10}.get(name, 0)
    np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=rounding)


def test_every_extension_is_tried():
    assert {"." + name.split(".")[1] for name in WRITERS} == set(READERS)


@NAMES
def test_capitals_and_a_missing_file(tmp_path, name):
    upper = tmp_path / name.upper()
    upper.write_bytes(WRITERS[name](tmp_path / name).read_bytes())
    assert len(read_points(upper).points) == len(POINTS)
    with pytest.raises(InputError, match=f"nowhere-{name}: no such file"):
        read_points(tmp_path / f"nowhere-{name}")


FOREIGN = {"empty": b"", "picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8 + b"!", "blank": b"\n\n", "zeros": bytes(997)}


@NAMES
@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN)
def test_a_foreign_file(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_points(path)


@NAMES
@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.97])
def test_a_truncated_file(tmp_path, name, part):
    path = WRITERS[name](tmp_path / name)
    whole = path.read_bytes()
    cut = whole[: int(part * len(whole))]
    if name.endswith((".xyz", ".txt", ".csv", ".asc")):  # text says not how long it is: the cut has to fall within a line
        cut = cut[: cut.rfind(b"\n") + 3].rstrip()
    path.write_bytes(cut + b"?" * (name == "a.bin" and len(cut) % 16 == 0))
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_points(path)


@pytest.mark.parametrize("name", [name for name in WRITERS if not name.endswith((".las", ".laz"))])
def test_nan_rows_are_beams_without_a_return(tmp_path, name):
    points = POINTS.copy()
    points[[0, 5, 17]] = np.nan
    scans = read_point_file(WRITERS[name](tmp_path / name, points), sensor_origin_m=[0, 0, 0])
    assert set(range(len(points))) - set(scans.beam.tolist()) == {0, 5, 17}
    if name == "a.e57":
        return  # its writer refuses a scan without a return
    with pytest.raises(InputError, match=f"{name}: expected returns, found 60 points and all of them NaN"):
        read_points(WRITERS[name](tmp_path / name, np.full_like(POINTS, np.nan)))


FORGED = {
    "a.ply": (b"element vertex 60", b"element vertex 1000000000"),
    "ascii.ply": (b"element vertex 60", b"element vertex 1000000000"),
    "big.ply": (b"element vertex 60", b"element vertex 1000000000000"),
    "a.pcd": (b" 60\n", b" 1000000000\n"),
    "packed.pcd": (b" 60\n", b" 1000000000\n"),
    "ascii.pcd": (b"COUNT 1 1 1", b"COUNT 1000000000 1 1"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_count_takes_no_memory(tmp_path, name):
    path = WRITERS[name](tmp_path / name)
    old, new = FORGED[name]
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new))
    tracemalloc.start()
    with pytest.raises(InputError, match=name):
        read_points(path)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


values = st.sampled_from([0, 255, *b"09- \n"]) | st.integers(0, 255)
mutations = st.lists(st.tuples(st.floats(0, 0.999), values), min_size=1, max_size=6)


def mutated(content: bytes, changes, cut: float, headed: bool) -> bytes:
    """Bytes changed anywhere, or within the first 400 where headers are; and what is beyond `cut` is gone."""
    content = bytearray(content)
    for place, value in changes:
        content[int(place * (min(400, len(content)) if headed else len(content)))] = value
    return bytes(content[: round(cut * len(content))])


def read_or_refuse(path):
    try:
        read_point_file(path, sensor_origin_m=[0, 0, 0])
    except InputError as error:
        assert str(path) in str(error)


@pytest.mark.parametrize("name", sorted(WRITERS.keys() - APART))
@settings(max_examples=150, suppress_health_check=[HealthCheck.differing_executors])
@given(changes=mutations, cut=st.just(1.0) | st.floats(0, 1), headed=st.booleans())
def test_changed_bytes_raise_nothing_but_input_errors(tmp_path_factory, name, changes, cut, headed):
    path = tmp_path_factory.getbasetemp() / f"changed-{name}"
    path.write_bytes(mutated(WRITERS[name](path).read_bytes(), changes, cut, headed))
    read_or_refuse(path)


# Fewer: each sound header starts a process.
@pytest.mark.parametrize("name", sorted(APART))
@settings(max_examples=15, suppress_health_check=[HealthCheck.differing_executors])
@given(changes=mutations, cut=st.just(1.0) | st.floats(0, 1), headed=st.booleans())
def test_changed_bytes_end_no_interpreter(tmp_path_factory, name, changes, cut, headed):
    path = tmp_path_factory.getbasetemp() / f"changed-{name}"
    path.write_bytes(mutated(WRITERS[name](path).read_bytes(), changes, cut, headed))
    read_or_refuse(path)


def test_the_origin_is_the_files_or_the_users_and_never_made_up(tmp_path):
    path = write_npz(tmp_path / "a.npz")
    with pytest.raises(InputError, match=r"a.npz: .*set reading.sensor_origin_m to 3 numbers"):
        read_point_file(path)
    scans = read_point_file(path, sensor_origin_m=[1, 2, 3])
    np.testing.assert_array_equal(scans.origins, np.broadcast_to([1, 2, 3], POINTS.shape))
    path = write_pcd(tmp_path / "a.pcd", viewpoint=(4.0, 5.0, 6.0, 1.0, 0.0, 0.0, 0.0))
    np.testing.assert_array_equal(np.unique(read_point_file(path).origins, axis=0), [[4, 5, 6]])
    said = r"a.pcd: says that its beams started at \[4.0, 5.0, 6.0\]; reading.sensor_origin_m=\[1.0, 2.0, 3.0\] is taken"
    with pytest.warns(UserWarning, match=said):
        found = read_point_file(path, sensor_origin_m=[1, 2, 3])
    np.testing.assert_array_equal(np.unique(found.origins, axis=0), [[1, 2, 3]])
    path = write_npz(tmp_path / "b.npz", scan=np.arange(60) // 20, origins=np.eye(3))
    with pytest.warns(UserWarning, match=r"b.npz: says that its beams started at 3 places, the first \[0.0, 0.0, 1.0\]; "):
        found = read_point_file(path, sensor_origin_m=[1, 2, 3])
    np.testing.assert_array_equal(np.unique(found.origins, axis=0), [[1, 2, 3]])
    with pytest.raises(InputError, match="reading.sensor_origin_m: expected 3 numbers"):
        read_point_file(path, sensor_origin_m=[1, 2])


def test_an_empty_pcd_says_so(tmp_path):
    (tmp_path / "a.pcd").write_bytes(b"")
    with pytest.raises(InputError, match="a.pcd: expected a PCD file's header, found nothing"):
        read_point_file(tmp_path / "a.pcd", sensor_origin_m=[0, 0, 0])


@pytest.mark.parametrize("origin", [[0, 0], [0, 0, np.nan], "abc", 5, [1, 2, "x"]])
def test_bad_sensor_origins(tmp_path, origin):
    with pytest.raises(InputError, match="reading.sensor_origin_m: expected 3 numbers"):
        read_point_file(write_text(tmp_path / "a.xyz"), sensor_origin_m=origin)


def test_ranges_are_lengths_of_beams_in_2d_and_3d(tmp_path):
    for dimension in (2, 3):
        origin = np.array([3.0, -2.0, 1.0])[:dimension]
        points = POINTS[:, :dimension]
        scans = read_point_file(write_text(tmp_path / "a.xyz", points), origin.tolist(), max_range_m=25.0, min_range_m=10.0)
        kept = [row for row, point in enumerate(points) if 10.0 < sum((point - origin) ** 2) ** 0.5 < 25.0]
        assert scans.dimension == dimension and scans.beam.tolist() == kept and not scans.scan.any()
        np.testing.assert_array_equal(scans.points, points[kept])
        np.testing.assert_array_equal(scans.origins, np.broadcast_to(origin, scans.points.shape))


def test_a_file_of_several_scans_is_put_in_their_order(tmp_path):
    scan = np.random.default_rng(3).choice([4, 9, 2, 30], len(POINTS))
    origins = np.random.default_rng(4).uniform(-1, 1, (31, 3))
    path = write_npz(tmp_path / "a.npz", scan=scan, origins=origins)
    scans = read_point_file(path)
    row = 0
    for number, value in enumerate(sorted(set(scan.tolist()))):
        for beam, place in enumerate(np.flatnonzero(scan == value)):
            assert (scans.scan[row], scans.beam[row]) == (number, beam)
            np.testing.assert_array_equal(scans.points[row], POINTS[place])
            np.testing.assert_array_equal(scans.origins[row], origins[value])
            row += 1
    assert row == len(scans)
    second = read_point_file(path, every=2)
    np.testing.assert_array_equal(second.points, scans.points[scans.scan % 2 == 0])
    np.testing.assert_array_equal(np.unique(second.scan), [0, 1])


def test_nothing_within_range_names_a_beam(tmp_path):
    expected = r"beams of 0.0 to 80.0 m, found none among 60; the first starts at \[1000000.0, 0.0, 0.0\]"
    with pytest.warns(UserWarning, match="the sensor's origin in another frame"), pytest.raises(InputError, match=expected):
        read_point_file(write_text(tmp_path / "a.xyz"), sensor_origin_m=[1e6, 0, 0])


@pytest.mark.parametrize("options", [{"max_range_m": 0}, {"min_range_m": -1}, {"max_range_m": np.nan}, {"every": 0}, {"every": 1.5}])
def test_bad_options_are_named(tmp_path, options):
    with pytest.raises(InputError, match=next(iter(options))):
        read_point_file(write_text(tmp_path / "a.xyz"), [0, 0, 0], **options)


def test_an_unknown_extension(tmp_path):
    with pytest.raises(InputError, match=r"a.abc: unknown extension '.abc'; known are .asc .bin .csv"):
        read_points(tmp_path / "a.abc")
    for name in ("folder", "folder.ply"):
        (tmp_path / name).mkdir()
        with pytest.raises(InputError, match=f"{name}: expected a file of points, found a folder"):
            read_points(tmp_path / name)


@pytest.mark.parametrize("viewpoint", [None, (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)])
def test_several_points_at_zero_are_no_returns(tmp_path, viewpoint):
    """Of a cloud with one origin, the file's or the user's; a single one may be a true place."""
    points = POINTS.copy()
    points[4] = 0
    scans = read_point_file(write_pcd(tmp_path / "a.pcd", points, viewpoint=viewpoint), sensor_origin_m=[0, 0, 0.5])
    assert scans.beam.tolist() == list(range(60))
    points[9] = 0
    scans = read_point_file(write_pcd(tmp_path / "a.pcd", points, viewpoint=viewpoint), sensor_origin_m=[0, 0, 0.5])
    assert set(range(60)) - set(scans.beam.tolist()) == {4, 9}


@pytest.mark.parametrize("arrays", [{"scan": np.arange(60) // 20}, {"origins": np.ones((60, 3))}])
def test_points_at_zero_of_a_map_are_places(tmp_path, arrays):
    points = POINTS.copy()
    points[[4, 9]] = 0
    assert len(read_point_file(write_npz(tmp_path / "a.npz", points, **arrays), sensor_origin_m=[0, 0, 0.5])) == 60
