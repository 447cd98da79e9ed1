"""ROS transforms (tf2): a tree of frames, each in its parent's, that move over time."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.frame_chains import are_connected, find_chain
from hilbertvae.scans.pose_track import PoseTrack
from hilbertvae.scans.rigid_motion import motion_between


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
        return None if there is None or back is None else motion_between(back, there)

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
