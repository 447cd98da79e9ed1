"""When each beam of a scan was measured, as messages of ROS bags say it: a sensor turns while its robot moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_messages import LASER_SCAN, read_column

FIELDS = ("t", "time", "timestamp", "time_stamp", "offset_time", "time_offset", "timeoffset", "t_offset")
"""What drivers call a point's time, in any case: Ouster's `t`, Velodyne's `time`, Hesai's and RoboSense's `timestamp`, Livox's
`offset_time`."""
SWEEP_S = (0.002, 1.0)
"""Lasers turn 5 to 50 times a second. No two of the units fit one sweep, since they are a factor of 1000 apart."""
LONGEST_SWEEP = 2.0
"""In times from one message to the next. Times that make a longer one are in no unit of time: shares of the sweep, from 0 to 1, look like
seconds."""
NANOSECONDS = (10**9, 10**6, 10**3, 1)
"""Those of a second, a milli-, a micro- and a nanosecond."""
YEAR_NS = 365 * 24 * 3600 * 10**9
"""Times since this and more ago are clocks' and no offsets."""


def beam_times(message, stamp_ns: int, returned: np.ndarray, step_ns: float = np.inf) -> np.ndarray | None:
    """(N,) int64 nanoseconds from a message's time to each of its beams'; None where it does not say, or nonsense.

    Of a `LaserScan` its `time_increment` says it. Of a `PointCloud2` a field of `FIELDS` does, in the unit in which the sweep takes a time
    that a sweep may take, from the message's time or by the clock. returned: (N,) bool; the times of beams without a return don't matter.
    step_ns: the usual time from one message to the next; see `LONGEST_SWEEP`.
    """
    laser = message.__msgtype__ == LASER_SCAN
    times = _times_of_laser(message) if laser else _times_of_cloud(message, stamp_ns, returned)
    return times if times is None or np.ptp(times) <= LONGEST_SWEEP * step_ns else None


def usual_step_ns(stamps_ns: Mapping[str, Sequence[int]]) -> float:
    """The median time from one message to the next, by the `stamps_ns` of each frame that a topic has sensors in; inf where there are no
    two."""
    steps = np.concatenate([np.empty(0), *(np.diff(np.array(stamps, np.float64)) for stamps in stamps_ns.values())])
    steps = steps[steps > 0]  # bags may be played twice
    return float(np.median(steps)) if len(steps) else np.inf


def says_times(message) -> bool:
    """Whether a message claims to say when its beams were measured, be it nonsense."""
    if message.__msgtype__ == LASER_SCAN:
        return message.time_increment != 0 and len(message.ranges) > 1
    return time_field(message) is not None


def time_field(message) -> str | None:
    """The field of a `PointCloud2` that is said to be a time; None of one that has none."""
    return next((field.name for field in message.fields if field.name.lower() in FIELDS), None)


def _times_of_cloud(message, stamp_ns: int, returned: np.ndarray) -> np.ndarray | None:
    name = time_field(message)
    try:
        values = None if name is None else read_column(message, name)
    except InputError:  # of a cloud whose points are sound
        return None
    return None if values is None or not returned.any() else _offsets(values, returned, stamp_ns)


def _times_of_laser(message) -> np.ndarray | None:
    with np.errstate(over="ignore"):
        seconds = float(message.time_increment) * (len(message.ranges) - 1)
    # Below 0 where a message's time is that of the last beam.
    if len(message.ranges) < 2 or not 0 < abs(seconds) <= SWEEP_S[1]:
        return None
    return np.round(np.linspace(0.0, seconds * 1e9, len(message.ranges))).astype(np.int64)


def _offsets(values: np.ndarray, returned: np.ndarray, stamp_ns: int) -> np.ndarray | None:
    """`values` (N,) of any numbers as nanoseconds after `stamp_ns`; those of no return become the first one's."""
    first, last = values[returned].min(), values[returned].max()
    if first == last:
        return np.zeros(len(values), np.int64)  # all at once, or turned back already
    with np.errstate(over="ignore", invalid="ignore"):
        sweep = float(last) - float(first)
        unit = next((each for each in NANOSECONDS if SWEEP_S[0] <= sweep * each / 1e9 <= SWEEP_S[1]), None)
    if unit is None:
        return None
    start_ns = _start_ns(first, unit)
    if start_ns > YEAR_NS:
        start_ns -= stamp_ns
    after = np.where(returned, values, first).astype(np.float64) - float(first)
    times = start_ns + np.round(after * unit).astype(np.int64)
    return times if np.abs(times).max() <= SWEEP_S[1] * 1e9 else None


def _start_ns(first: np.number, unit: int) -> int:
    """A time as a whole number: seconds since 1970 are known to a quarter of a microsecond in float64, and would lose more times 1e9."""
    whole, part = divmod(first.item(), 1)
    return int(whole) * unit + round(part * unit)
