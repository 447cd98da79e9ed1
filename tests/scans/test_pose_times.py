import warnings
from pathlib import Path

import numpy as np
import pytest

from hilbertvae.scans.pose_times import warn_of_other_times
from hilbertvae.scans.scan_folder import read_scan_folder

EPOCH = 1_305_031_102.25
TIMES = EPOCH + 0.1 * np.arange(6)


def files(names):
    return [Path(f"{name}.pcd") for name in names]


@pytest.mark.parametrize("digits", [0, 3, 6, 9])
@pytest.mark.parametrize("shift", [1, -3, 40])
def test_poses_of_other_scans_are_told(digits, shift):
    """Names in seconds, and in milli-, micro- and nanoseconds as whole numbers."""
    later = TIMES + 0.1 * shift
    names = [f"{time:.6f}" if digits == 0 else str(round(time * 1000) * 10 ** (digits - 3)) for time in TIMES]
    said = rf"poses.txt: the time of pose \d is {abs(0.1 * shift):.4g} s off .* \d+(\.\d+)?.pcd, where scans are 0.1 s apart"
    with pytest.warns(UserWarning, match=said):
        warn_of_other_times(files(names), later, Path("poses.txt"))


def test_the_scan_that_is_farthest_off_is_named():
    names = [f"{time:.3f}" for time in (*TIMES[:3], *(TIMES[3:] + 0.1))]
    names[4] = f"{TIMES[4] + 0.15:.3f}"
    with pytest.warns(UserWarning, match=rf"pose 5 is 0.15 s off that in the name of its scan, {names[4]}.pcd"):
        warn_of_other_times(files(names), TIMES, Path("poses.txt"))


@pytest.mark.parametrize(
    ("names", "times"),
    [
        ([f"{number:06d}" for number in range(6)], TIMES),  # counted
        ([f"{number:06d}" for number in range(1, 7)], np.arange(6.0)),  # counted from 1, a scan a second
        ([f"{5 * number:06d}" for number in range(6)], 0.5 * np.arange(6.0)),
        ([f"{time:.6f}" for time in TIMES], TIMES),
        ([f"{time + 0.04:.6f}" for time in TIMES], TIMES),  # as a camera's trigger is off the lidar's
        ([f"{time - EPOCH:.6f}" for time in TIMES], TIMES),  # since the start of the drive
        ([f"{time:.6f}" for time in TIMES + 1e6], TIMES),  # another clock
        ([f"scan_{time + 1:.6f}" for time in TIMES], TIMES),
        ([f"{TIMES[0] + 1:.6f}"], TIMES[:1]),
        ([f"{time:.6f}" for time in TIMES], np.full(6, EPOCH)),
    ],
)
def test_nothing_is_said_of_names_that_are_no_times_or_agree(names, times):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_other_times(files(names), times, Path("poses.txt"))


def test_a_folder_whose_poses_are_shifted_by_a_scan(tmp_path):
    for number in range(4):
        (tmp_path / f"{100 + number}.000.xyz").write_text("1 0 0\n0 1 0.5\n2 2 1\n")
    (tmp_path / "poses.txt").write_text("".join(f"{101 + number} {number} 0 0 0 0 0 1\n" for number in range(4)))
    with pytest.warns(UserWarning, match="the time of pose 1 is 1 s off that in the name of its scan, 100.000.xyz"):
        scans = read_scan_folder(tmp_path)
    assert scans.origins[::3, 0].tolist() == [0, 1, 2, 3]
