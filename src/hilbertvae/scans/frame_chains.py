"""The chain of frames between two of them, where frames may have several parents.

tf2 wants a tree, but bags keep what several nodes said: wheel odometry and a filter both publish the robot's base, in `odom` and in
`odom_combined`. A frame of two parents does no harm so long as one chain alone leads to where points are wanted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hilbertvae.checks import InputError

Parents = Mapping[str, Sequence[str]]
"""By frame, those it has a pose in."""


MOST_NAMED = 20
"""Frames that a message looks at and names."""


def are_connected(parents: Parents, frame: str, other: str) -> bool:
    """Whether some frame is above both. Raises `InputError` for a loop."""
    return not _ways_up(parents, frame).keys().isdisjoint(_ways_up(parents, other))


def find_chain(parents: Parents, frame: str, fixed: str) -> tuple[list[str], list[str]] | None:
    """From `frame` and from `fixed`, each up to the lowest frame above both, itself included; None where there is none.

    If `fixed` is above `frame`, that is the way, whatever else is above both. Raises `InputError` for a loop, and for several chains.
    """
    up, down = _ways_up(parents, frame), _ways_up(parents, fixed)
    shared = up.keys() & down.keys()
    lowest = sorted({fixed} & shared or shared - {parent for name in shared for parent in parents.get(name, ())})
    if not lowest:
        return None
    there, back = _only_way(up, lowest[0]), _only_way(down, lowest[0])
    if len(lowest) > 1 or there is None or back is None:
        single = [name for name in list(up)[:MOST_NAMED] if name != frame and _only_way(up, name)]
        hint = f"; one chain leads to {', '.join(single)}: set reading.fixed_frame to one of these, if it stands still" if single else ""
        several = "; ".join(
            f"{name} in {' and in '.join(parents[name])}" for name in [*up, *down][:MOST_NAMED] if len(parents.get(name, ())) > 1
        )
        raise InputError(f"transforms: expected one chain from {frame} to {fixed}, found several ({several}){hint}")
    return there, back


def _ways_up(parents: Parents, frame: str) -> dict[str, list[str]]:
    """A frame and all above it, each with those that it is the parent of on the way; an `InputError` for a loop among them."""
    # Depth first, to see loops, and without recursion: a forged bag may have chains of any length.
    found: dict[str, list[str]] = {frame: []}
    way, left = {frame: None}, [iter(parents.get(frame, ()))]
    while left:
        name, parent = next(reversed(way)), next(left[-1], None)
        if parent is None:
            left.pop()
            way.popitem()
        elif parent in way:
            names = list(way)
            raise InputError(f"transforms: expected a tree, found a loop: {' in '.join([*names[names.index(parent) :], parent])}")
        else:
            is_new = parent not in found
            found.setdefault(parent, []).append(name)
            if is_new:
                way[parent] = None
                left.append(iter(parents.get(parent, ())))
    return found


def _only_way(ways: Mapping[str, Sequence[str]], top: str) -> list[str] | None:
    """The names from the start of `ways` up to `top`, or None where several ways lead there."""
    names = [top]
    while below := ways[names[-1]]:
        if len(below) > 1:
            return None
        names.append(below[0])
    return names[::-1]
