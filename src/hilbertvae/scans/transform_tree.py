"""ROS transforms (tf2): a tree of frames, each in its parent's, that move over time."""

from __future__ import annotations

import warnings
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.frame_chains import are_connected, find_chain
from hilbertvae.scans.poses import FARTHEST_M
from hilbertvae.scans.quaternions import rotation_matrices, slerp

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
    matrix[:3, :3], matrix[:3, 3] = rotation_matrices(quaternion), place
    return matrix


def _inverse(pose: np.ndarray) -> np.ndarray:
    """Of a rigid motion (4, 4): exact to the last bits for places of UTM's size, too."""
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]
    return inverse


@dataclass(frozen=True)
class Sources:
    """Of one frame, which topic's transforms were kept, or None where none stands out, and the others that say otherwise."""

    kept: str | None
    others: tuple[str, ...]


class TransformTree:
    """Frames by name, without the leading slash that ROS 1 may have. What is static holds at all times.

    A frame has one parent, or several of which one leads to where poses are wanted; see `find_chain`.
    """

    def __init__(self):
        self._moving: dict[tuple[str, str], PoseTrack] = {}
        self._static: dict[tuple[str, str], PoseTrack] = {}
        self._parents: dict[str, list[str]] = defaultdict(list)
        self._chains: dict[tuple[str, str], tuple[list[str], list[str]] | None] = {}
        self.sources: dict[tuple[bool, str], Sources] = {}
        """By whether it is static and by frame: those that several topics have, and not alike."""
        self.passed_over: dict[str, Sources] = {}
        """Those of them that a pose went by."""

    def add(self, parent: str, child: str, stamp_ns: int, translation, rotation, static: bool) -> None:
        """A sample of the pose of `child` in `parent`; see `PoseTrack.add`. The last static one of a frame is what holds."""
        edge = parent, child = parent.lstrip("/"), child.lstrip("/")
        if parent not in self._parents[child]:
            self._parents[child].append(parent)
            self._chains.clear()
        if static:
            self._static[edge] = PoseTrack(f"transform from {child} to {parent}")
            self._static[edge].add(stamp_ns, translation, rotation)
        else:
            self._moving.setdefault(edge, PoseTrack(f"transform from {child} to {parent}")).add(stamp_ns, translation, rotation)

    def take(self, other: TransformTree, children: set[str]) -> None:
        """All that another tree says of some frames."""
        for mine, theirs in ((self._moving, other._moving), (self._static, other._static)):
            mine |= {edge: track for edge, track in theirs.items() if edge[1] in children}
        for child in other._parents.keys() & children:
            self._parents[child] += [parent for parent in other._parents[child] if parent not in self._parents[child]]
        self._chains.clear()

    def agrees(self, other: TransformTree, child: str) -> bool:
        """Whether two trees say the same of a frame; see `PoseTrack.agrees`."""
        if set(self._parents[child]) != set(other._parents[child]):
            return False
        edges = [(parent, child) for parent in self._parents[child]]
        return all(self._track(edge).agrees(other._track(edge)) for edge in edges)

    @property
    def children(self) -> list[str]:
        """All frames that have a pose in another."""
        return list(self._parents)

    @property
    def frames(self) -> list[str]:
        """All frames that are named, sorted."""
        return sorted({*self._parents, *(parent for parents in self._parents.values() for parent in parents)})

    def connects(self, fixed: str, frame: str) -> bool:
        """Whether there is a chain of transforms between two frames, at whatever time."""
        return are_connected(self._parents, frame, fixed)

    def pose(self, fixed: str, frame: str, stamp_ns: int) -> np.ndarray | None:
        """(4, 4): takes points of `frame` to `fixed` at a time. None where the chain between them does not cover that time.

        Raises `InputError` for several chains, for a loop, and for a transform on the way that is no rigid motion, or that topics differ
        about of which none stands out.
        """
        if (fixed, frame) not in self._chains:
            self._chains[fixed, frame] = find_chain(self._parents, frame, fixed)
            for names in self._chains[fixed, frame] or ():
                self._note_sources(names)
        chain = self._chains[fixed, frame]
        if chain is None:
            return None
        there, back = (self._climb(names, stamp_ns) for names in chain)
        return None if there is None or back is None else _inverse(back) @ there

    def tracks(self, fixed: str, frame: str) -> list[PoseTrack]:
        """Those that `pose` has gone by from one frame to another; none where it was not asked."""
        chain = self._chains.get((fixed, frame)) or ()
        return [self._track((parent, child)) for names in chain for child, parent in zip(names[:-1], names[1:], strict=True)]

    def _note_sources(self, names: list[str]) -> None:
        for child, parent in zip(names[:-1], names[1:], strict=True):
            found = self.sources.get(((parent, child) not in self._moving, child))
            if found and not found.kept:
                raise InputError(
                    f"transforms: {child} is elsewhere in each of {' and '.join(found.others)}, and none of these is the scans' own by its "
                    "namespace, nor /tf; keep one of them in the bag, or set reading.topic to scans in the namespace of one"
                )
            if found:
                self.passed_over[child] = found

    def _track(self, edge: tuple[str, str]) -> PoseTrack:
        return self._moving.get(edge) or self._static[edge]

    def _climb(self, names: list[str], stamp_ns: int) -> np.ndarray | None:
        pose = np.eye(4)
        for child, parent in zip(names[:-1], names[1:], strict=True):
            step = self._track((parent, child)).at(stamp_ns)
            if step is None:
                return None
            pose = step @ pose
        return pose
