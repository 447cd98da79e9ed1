"""`ROBOTLASER1` messages of CARMEN logs, and what `FLASER` has beside them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from toy_rooms import carmen_line, write_log


def robot_line(ranges, pose, first=-math.pi / 2, step=math.pi / 180, farthest=81.9, remissions=(), robot=(9.0, 9.0, 9.0)) -> str:
    """One message: the laser's pose is `pose`, the robot's another; behind them what a logger adds."""

    def said(*values):
        return " ".join(repr(float(value)) for value in values)

    beams = f"{first!r} {step * max(len(ranges) - 1, 0)!r} {step!r} {farthest!r} 0.01 0 {len(ranges)} {said(*ranges)}"
    return f"ROBOTLASER1 0 {beams} {len(remissions)} {said(*remissions, *pose, *robot)} 0.1 0.2 0.5 0.4 0.0 1.0 host 1.0\n"


@settings(max_examples=40)
@given(
    beams=st.integers(1, 60),
    first=st.floats(-3.0, 0.5),
    step=st.floats(0.001, 0.1),
    pose=st.tuples(*[st.floats(-50, 50)] * 3),
    remissions=st.integers(0, 5),
)
def test_what_was_written_is_read_back(tmp_path_factory, beams, first, step, pose, remissions):
    ranges = np.random.default_rng(beams).uniform(0.5, 20.0, beams)
    line = robot_line(ranges, pose, first, step, remissions=[0.5] * remissions)
    scans = read_carmen(write_log(tmp_path_factory.mktemp("log") / "a.log", [line]))
    x, y, heading = pose
    for beam in range(beams):
        angle = heading + first + beam * step
        end = [x + ranges[beam] * math.cos(angle), y + ranges[beam] * math.sin(angle)]
        np.testing.assert_allclose(scans.points[beam], end, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(scans.beam, range(beams))
    np.testing.assert_array_equal(scans.origins, np.tile([x, y], (beams, 1)))


def test_what_the_laser_can_not_measure_is_skipped(tmp_path):
    ranges = np.full(180, 3.0)
    ranges[[0, 7, 8]] = [8.0, 9.0, 7.99]
    path = write_log(tmp_path / "a.log", [robot_line(ranges, [0, 0, 0], farthest=8.0)])
    assert set(range(180)) - set(read_carmen(path).beam.tolist()) == {0, 7}
    assert len(read_carmen(path, max_range_m=5.0)) == 177
    unsaid = write_log(tmp_path / "b.log", [robot_line(ranges, [0, 0, 0], farthest=0.0)])
    assert len(read_carmen(unsaid)) == 180


def test_a_count_that_no_laser_has_needs_no_guess(tmp_path, recwarn):
    path = write_log(tmp_path / "a.clf", [robot_line([2.0, 2.0, 2.0], [0, 0, 0], -math.pi / 2, math.pi / 2)])
    np.testing.assert_allclose(read_scans_path(path).points, [[0, -2], [2, 0], [0, 2]], atol=1e-12)
    assert not recwarn.list
    given = read_scans_path(path, ReadingSettings(beam_step_deg=45.0)).points
    np.testing.assert_allclose(
        given, 2 * np.array([[math.sqrt(0.5), -math.sqrt(0.5)], [1, 0], [math.sqrt(0.5), math.sqrt(0.5)]]), atol=1e-12
    )


@pytest.mark.parametrize("first_kind", ["FLASER", "ROBOTLASER1"])
def test_a_sweep_that_is_logged_as_both_counts_once(tmp_path, first_kind, recwarn):
    lines = []
    for number in range(3):
        pair = [carmen_line(np.full(180, 2.0), [number, 0, 0]), robot_line(np.full(180, 2.0), [number, 5, 0])]
        lines += pair if first_kind == "FLASER" else pair[::-1]
    scans = read_carmen(write_log(tmp_path / "a.log", lines))
    np.testing.assert_array_equal(np.unique(scans.scan), range(3))
    assert set(scans.origins[:, 1]) == {0.0 if first_kind == "FLASER" else 5.0}
    assert not recwarn.list


def test_sweeps_of_another_kind_are_not_passed_over_without_a_word(tmp_path):
    lines = [carmen_line(np.full(180, 2.0), [0, 0, 0])] + [robot_line(np.full(180, 2.0), [number, 0, 0]) for number in range(5)]
    with pytest.warns(UserWarning, match="a.log: read are its 1 FLASER messages alone, and not 5 ROBOTLASER1 ones"):
        assert set(read_carmen(write_log(tmp_path / "a.log", lines)).scan) == {0}


@pytest.mark.parametrize("line", [carmen_line([], [0, 0, 0]), robot_line([], [0, 0, 0])])
def test_a_sweep_of_no_beams_saw_nothing(tmp_path, line, recwarn):
    other = (carmen_line if line.startswith("FLASER") else robot_line)(np.full(180, 2.0), [1, 0, 0])
    scans = read_carmen(write_log(tmp_path / "a.log", [line, other]))
    assert len(scans) == 180 and set(scans.scan) == {1} and not recwarn.list


HEAD = "ROBOTLASER1 0 -1.57 3.14 0.0175 80 0.01 0"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (f"{HEAD}\n", "line 3: expected 'ROBOTLASER1 type first_angle"),
        (f"{HEAD} two 1 1 0 0 0 0\n", "line 3: expected 'ROBOTLASER1 type first_angle"),
        (f"{HEAD} 1000000 1 1 0 0 0 0\n", "line 3: expected at most 4096 ranges, the line claims 1000000"),
        (f"{HEAD} 3 1.0 2.0\n", "line 3: truncated; 3 ranges claimed, 2 numbers found"),
        (f"{HEAD} 2 1.0 2.0\n", "line 3: expected 'ROBOTLASER1 with a number of remissions behind its 2 ranges'"),
        (f"{HEAD} 2 1.0 2.0 0.5 0 0 0\n", "line 3: expected 'ROBOTLASER1 with a number of remissions behind its 2 ranges'"),
        (f"{HEAD} 2 1.0 2.0 1 0.5 0 0\n", "line 3: truncated; 2 ranges, 1 remissions and a pose claimed, 2 numbers found"),
        (f"{HEAD} 2 1.0 2.0 0 nan 0 0\n", "line 3: expected a finite pose"),
        (f"{HEAD} 1 one 0 0 0 0\n", "line 3: expected numbers"),
        (HEAD.replace("0.0175", "0") + " 2 1.0 2.0 0 0 0 0\n", "line 3: expected radians within a turn.*or set reading.beam_step_deg"),
        (HEAD.replace("0.0175", "1.0") + " 9 1 1 1 1 1 1 1 1 1 0 0 0 0\n", "line 3: expected radians within a turn"),
        (HEAD.replace("-1.57", "-90") + " 2 1.0 2.0 0 0 0 0\n", "line 3: expected radians within a turn"),
    ],
)
def test_bad_lines_are_named(tmp_path, line, message):
    with pytest.raises(InputError, match=f"bad.log.*{message}"):
        read_carmen(write_log(tmp_path / "bad.log", [line]))


def test_a_rear_laser_and_raw_sweeps_are_left_out(tmp_path):
    line = robot_line(np.full(180, 2.0), [0, 0, 0])
    others = [line.replace("ROBOTLASER1", name) for name in ("ROBOTLASER2", "RAWLASER1", "ROBOTLASER10")]
    assert len(read_carmen(write_log(tmp_path / "a.log", [*others, line]))) == 180
