import tracemalloc

import numpy as np
import pytest
from bag_scene import CLOUDS, RANGES, read_or_refuse
from bag_writers import KINDS, bag, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag

pytest.importorskip("rosbags")


def test_no_returns_of_a_laser(tmp_path):
    nan, inf = float("nan"), float("inf")
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "laser", ((0, 0, 0), turned(0)))
        made.laser("/scan", 0.0, "laser", [nan, inf, -inf, 0, -1, 0.05, 0.1, 5, 29.9, 30.0, 31.0, 81.83, 7])
        made.laser("/none", 0.0, "laser", [nan, inf, 0, 50])
    assert read_bag(tmp_path / "a.bag", topic="/scan").beam.tolist() == [6, 7, 8, 12]
    with pytest.raises(InputError, match="expected beams of 0.0 to 80.0 m on /none, found none in 1 scans"):
        read_bag(tmp_path / "a.bag", topic="/none")


@pytest.mark.parametrize("high", [0.0, 0.1, -1.0])
def test_a_range_max_that_was_never_set_is_no_limit(tmp_path, high):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "laser", ((0, 0, 0), turned(0)))
        made.laser("/scan", 0.0, "laser", [float("inf"), 0, 0.05, 5, 29.9, 70.0, 81.0], high=high)
    assert read_bag(tmp_path / "a.bag").beam.tolist() == [3, 4, 5]


def test_no_returns_of_a_cloud(tmp_path):
    points = np.array([[1, 2, 3], [np.nan] * 3, [0, 0, 0], [np.inf, 0, 0], [4, 5, 6], [79, 79, 79]], dtype=float)
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", points, rows=2)
    assert read_bag(tmp_path / "a.bag").beam.tolist() == [0, 4]


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_numbers_of_a_cloud(tmp_path, kind):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], kind, rows=3)
    np.testing.assert_array_equal(read_bag(tmp_path / "a.bag").points, CLOUDS[0])


def test_a_laser_that_leans(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "base", ((0, 0, 0), turned(0)))
        made.transform("/tf_static", 0, "base", "laser", ((0, 0, 0), turned(0, 0.5)))
        made.laser("/scan", 0.0, "laser", RANGES[0])
    with pytest.raises(InputError, match="leans more than 15 degrees"):
        read_bag(tmp_path / "a.bag")


FORGED = {
    "width": {"width": 10**9},
    "height": {"height": 10**9},
    "both": {"width": 2**32 - 1, "height": 2**32 - 1},
    "row_step": {"row_step": 2**31},
    "short_rows": {"row_step": 20},
    "point_step": {"point_step": 2**31},
    "narrow": {"point_step": 8},
    "data": {"data": np.zeros(50, np.uint8)},
}


@pytest.mark.parametrize("name", FORGED)
@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_forged_cloud_takes_no_memory(tmp_path, kind, name):
    path = tmp_path / KINDS[kind]
    with bag(path, kind) as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], rows=2, **FORGED[name])
    read_or_refuse(path)  # what is imported late is imported now
    tracemalloc.start()
    with pytest.raises(InputError, match=rf"{path.name}, a message of /points: (truncated or forged cloud|expected . as one number)"):
        read_bag(path)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_fields_of_a_cloud_that_are_no_coordinates(tmp_path):
    def fields(made, **changes):
        each = {name: {"offset": 4 * place, "datatype": 7, "count": 1} for place, name in enumerate("xyz")}
        each["z"] |= changes
        return [made.make("sensor_msgs/PointField", name, **values) for name, values in each.items()]

    with bag(tmp_path / "unset.bag") as made:  # a count of 0 is that of a writer who never set it
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], fields=fields(made, count=0))
    np.testing.assert_array_equal(read_bag(tmp_path / "unset.bag").points, CLOUDS[0])
    for number, (changes, message) in enumerate(
        [({"offset": 2**32 - 1}, "expected z as one number"), ({"datatype": 99}, "datatype 99"), ({"count": 10**9}, "count 1000000000")]
    ):
        path = tmp_path / f"{number}.bag"
        with bag(path) as made:
            made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
            made.cloud("/points", 0.0, "lidar", CLOUDS[0], fields=fields(made, **changes))
        with pytest.raises(InputError, match=message):
            read_bag(path)
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], fields=fields(made)[:2])
    with pytest.raises(InputError, match="expected fields x, y, z, the cloud has x y"):
        read_bag(tmp_path / "a.bag")


def test_clouds_of_nothing_without_their_fields_are_scans_without_returns(tmp_path):
    """Of a node that publishes before it has seen anything."""
    nothing = {"width": 0, "height": 0, "fields": [], "point_step": 0, "row_step": 0, "data": np.zeros(0, np.uint8)}
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], **nothing)
        made.cloud("/points", 0.1, "lidar", CLOUDS[0])
    np.testing.assert_array_equal(read_bag(tmp_path / "a.bag").points, CLOUDS[0])


@pytest.mark.parametrize("step", [0, 7, 2**31])
def test_a_step_of_rows_is_not_needed_where_nothing_is_between_them(tmp_path, step):
    points = CLOUDS[0].astype("<f4")
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0], rows=2, row_step=step, point_step=12, data=points.reshape(-1).view(np.uint8))
    np.testing.assert_array_equal(read_bag(tmp_path / "a.bag").points, points)


@pytest.mark.parametrize("origin", ["centre", (0.0, 0.1, 0.2)])
def test_a_cloud_s_own_code_for_no_return_is_told_and_dropped_as_told(tmp_path, origin):
    """Where float32 has it a little shorter, too."""
    rng = np.random.default_rng(2)
    beams = rng.normal(size=(400, 3))
    beams *= (np.r_[rng.uniform(1, 11, 300), np.full(100, 12.3)] / np.linalg.norm(beams, axis=1))[:, None]
    with bag(tmp_path / "a.bag") as made:
        for number in range(3):
            made.transform("/tf", number, "map", "lidar", ((number, 0, 0), turned(0)))
            made.cloud("/points", number, "lidar", beams + (0 if origin == "centre" else origin))
    with pytest.warns(UserWarning, match="a.bag: 25 % of all ranges are the largest, 12.3 m.*Set reading.max_range_m=12.285 to drop them"):
        assert len(read_bag(tmp_path / "a.bag", beam_origin=origin)) == 1200
    assert len(read_bag(tmp_path / "a.bag", beam_origin=origin, max_range_m=12.285)) == 900
