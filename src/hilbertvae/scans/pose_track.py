"""The pose of one frame in another over time, of samples as transforms and odometry have them."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError
from hilbertvae.scans.poses import FARTHEST_M
from hilbertvae.scans.quaternions import slerp

LONGEST_HOLE_S = 10.0
"""Between two samples that are farther apart there is no pose, as in tf2, which remembers so much: meanwhile a robot may have been carried.
Of what comes more rarely they may be `MANY_STEPS` times as far apart as half of its samples are."""
BACK_S, APART_M = 1.0, 0.5
"""From when on times that fall back are another run's, if the frame is so far from where it was at these times before."""
MOST_RUNS = 8
"""So many of the farthest falls are looked at: of two publishers one of which is late, every sample may be one."""
MANY_STEPS = 5
UNIT = 1e-2
"""How far the square of a quaternion's length may be from 1, as in tf2: some are written by hand, with two digits."""


class PoseTrack:
    """The pose of one frame in another over time: samples in any order, and between two of them the way that both ends suggest."""

    def __init__(self, name: str):
        self.name = name
        """What messages call it."""
        self._rows: list[tuple[float, ...]] = []
        self._stamps: list[int] = []
        self._runs: list[tuple[int, int]] = []
        self._sorted: tuple[np.ndarray, np.ndarray, float] | None = None
        self._latest_ns = 0

    def add(self, stamp_ns: int, translation, rotation) -> None:
        """A sample: nanoseconds, and ROS's `Vector3` (or `Point`) in metres and `Quaternion`."""
        if self._stamps and stamp_ns < self._latest_ns - BACK_S * 1e9:
            self._runs.append((self._latest_ns - stamp_ns, len(self._stamps)))
            self._latest_ns = stamp_ns
        self._latest_ns = max(stamp_ns, self._latest_ns) if self._stamps else stamp_ns
        self._stamps.append(stamp_ns)
        self._rows.append((translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w))
        self._sorted = None

    def at(self, stamp_ns: int) -> np.ndarray | None:
        """(4, 4) at a time: interpolated, places on a line and turns at a constant rate. None before the first sample, after the last, and
        in a hole (`LONGEST_HOLE_S`).

        A single sample holds at all times. Samples that are no rigid motion are left out with a warning, as are those whose quaternion was
        never set, as drivers send them before they know; where half and more are none, that is an `InputError`.
        """
        stamps, rows, longest_ns = self._samples()
        if len(stamps) == 1:
            return _matrix(rows[0, :3], rows[0, 3:])
        after = int(np.searchsorted(stamps, stamp_ns))
        if after == len(stamps) or (after == 0 and stamps[0] != stamp_ns):
            return None
        if stamps[after] == stamp_ns:
            return _matrix(rows[after, :3], rows[after, 3:])
        if stamps[after] - stamps[after - 1] > longest_ns:
            return None
        share = float(stamp_ns - stamps[after - 1]) / float(stamps[after] - stamps[after - 1])
        first, second = rows[after - 1], rows[after]
        return _matrix(first[:3] + share * (second[:3] - first[:3]), slerp(first[3:], second[3:], share))

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """The times of its first sample and its last one; None of a single one, which holds at all times."""
        return (min(self._stamps), max(self._stamps)) if len(self._stamps) > 1 else None

    def agrees(self, other: PoseTrack) -> bool:
        """Whether one of two tracks has no sample that the other doesn't; of single ones, which hold at all times, whatever their times."""
        first, second = (np.column_stack([np.array(track._stamps, np.float64), np.array(track._rows)]) for track in (self, other))
        if len(first) == len(second) == 1:
            return bool((first[:, 1:] == second[:, 1:]).all())
        first, second = (np.unique(rows, axis=0) for rows in (first, second))
        return len(np.unique(np.concatenate([first, second]), axis=0)) == max(len(first), len(second))

    def _samples(self) -> tuple[np.ndarray, np.ndarray, float]:
        """The times (S,) int64, increasing, the samples (S, 7), and from how many nanoseconds on there is a hole between two."""
        if self._sorted is None:
            stamps, last = np.unique(np.array(self._stamps[::-1], np.int64), return_index=True)  # of one time, the last that came
            rows = np.array(self._rows[::-1])[last]
            unset = ~rows[:, 3:].any(axis=1)
            if unset.any() and not unset.all():
                warnings.warn(f"{self.name}: {unset.sum()} of {len(rows)} have a quaternion of zeros and are left out", stacklevel=3)
                stamps, rows = stamps[~unset], rows[~unset]
            with np.errstate(over="ignore", invalid="ignore"):
                squared = np.square(rows[:, 3:]).sum(axis=1)
                sound = (np.abs(squared - 1) <= UNIT) & (np.abs(rows[:, :3]) <= FARTHEST_M).all(axis=1)
            if not sound.all():
                wrong = f"a place in metres and a unit quaternion, got {rows[np.flatnonzero(~sound)[0]].tolist()}"
                if 2 * sound.sum() <= len(rows):
                    raise InputError(f"{self.name}: expected {wrong}")
                warnings.warn(f"{self.name}: {(~sound).sum()} of {len(rows)} are left out; expected {wrong}", stacklevel=3)
                stamps, rows = stamps[sound], rows[sound]
            self._warn_of_runs()
            rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
            usual_ns = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
            self._sorted = stamps, rows, max(LONGEST_HOLE_S * 1e9, MANY_STEPS * usual_ns)
        return self._sorted

    def _warn_of_runs(self) -> None:
        """A `UserWarning` where times fall back to when the samples before had the frame elsewhere: two drives whose scans can't be told
        apart, as of a simulator that was set back. A recording that was played twice says the same twice."""
        stamps, places = np.array(self._stamps, np.float64), np.array([row[:3] for row in self._rows])
        for back_ns, start in sorted(self._runs)[-MOST_RUNS:]:
            before = np.argsort(stamps[:start], kind="stable")
            again = start + np.flatnonzero((stamps[start:] >= stamps[:start].min()) & (stamps[start:] <= stamps[:start].max()))
            then = np.column_stack([np.interp(stamps[again], stamps[before], axis[before]) for axis in places[:start].T])
            with np.errstate(over="ignore", invalid="ignore"):  # of samples that are no place
                apart_m = np.linalg.norm(places[again] - then, axis=1)
            if len(again) and np.median(apart_m) > APART_M:
                said = f"its times fall back by {back_ns / 1e9:.3g} s, to when it was {np.median(apart_m):.2g} m away before"
                advice = "are these two drives? Cut the recording there, since scans of both are put on one way"
                warnings.warn(f"{self.name}: {said}: {advice}", stacklevel=3)
                return


def _matrix(place: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), place
    return matrix
