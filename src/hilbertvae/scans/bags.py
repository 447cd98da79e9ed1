"""Reader of ROS bags, through rosbags: ROS 1 (.bag), ROS 2 (a folder with metadata.yaml, or one .db3 or .mcap of it), and a folder of the
parts of one recording."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, extra_module, named
from hilbertvae.progress import track
from hilbertvae.scans.bag_chunks import bounded_unpacking
from hilbertvae.scans.bag_doubts import BagDoubts
from hilbertvae.scans.bag_messages import DIMENSIONS, LASER_SCAN, READERS
from hilbertvae.scans.bag_poses import STANDING
from hilbertvae.scans.beam_lengths import ClippedCheck, beam_lengths, without_zeros
from hilbertvae.scans.beam_origins import find_beam_origins
from hilbertvae.scans.deskewing import deskewed_along
from hilbertvae.scans.file_points import LIDAR_RANGE_M, check_reading, reading
from hilbertvae.scans.odometry import FINDING, KissOdometry, check_poses_choice
from hilbertvae.scans.opened_bag import OpenedBag, opened_bag
from hilbertvae.scans.point_times import beam_times, says_times
from hilbertvae.scans.poses import leans
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_collector import ScanCollector


def read_bag(
    path: str | os.PathLike,
    topic: str | None = None,
    fixed_frame: str | None = None,
    beam_origin: str | Sequence[float] = "centre",
    max_range_m: float = LIDAR_RANGE_M,
    min_range_m: float = 0.0,
    every: int = 1,
    poses: str | None = None,
    deskew: bool = True,
    odometry: str | None = None,
) -> Scans:
    """The scans of one topic, 2D from `sensor_msgs/LaserScan` and 3D from `sensor_msgs/PointCloud2` or Livox' `CustomMsg`.

    Scans are in the order of the bag. topic: by default the one of such messages that has most. Poses are those of `BagPoses` at the
    message's time, in `fixed_frame`, of the topic `odometry` where that is given; a scan without one is left out, with a warning.
    `poses="kiss_icp"` finds them from the scans instead, for clouds. deskew: beams are turned back one by one, where messages say when
    each was measured (`beam_times`); unset it for clouds that were, but still say so. beam_origin and ranges are as in
    `read_scan_folder`; `every` keeps every n-th message. Scans are numbered from 0, beams by their place in the message.

    The bag is read twice, transforms and then scans (and before, the first of these), a chunk at a time: memory grows with the returns
    that are kept. Messages have the types that ROS defines, whatever definitions the bag brings along. Raises `InputError` for files that
    are missing or damaged, and where there are no scans or no poses, with the topics or frames that are there.
    """
    path = Path(path)
    check_reading(min_range_m, max_range_m, every)
    check_poses_choice(poses)
    if poses is not None and fixed_frame is not None:
        raise InputError(f"reading.fixed_frame: with reading.poses={poses} the frame is that of the first scan; leave one of them unset")
    if poses is not None and odometry is not None:
        raise InputError(f"reading.odometry: with reading.poses={poses} none is read; leave one of them unset")
    extra_module("bags", "rosbags")
    with reading(path, "a ROS bag"), bounded_unpacking(path), opened_bag(path) as bag:
        chosen = bag.scan_topic(topic)
        is_flat = bag.types[chosen] == LASER_SCAN
        for name, setting, neutral in (("poses", poses, None), ("beam_origin", beam_origin, "centre")):
            if is_flat and setting != neutral:
                raise InputError(f"reading.{name}: {chosen} of {path} are planar laser scans, where this has no meaning; leave it unset")
        finder = bag.poses(chosen, fixed_frame, odometry) if poses is None else None
        beam_origins, kiss, clipped = find_beam_origins(beam_origin), KissOdometry(), ClippedCheck(max_range_m, not is_flat)
        found, doubts, frames, poses_seen = ScanCollector(min_range_m, max_range_m), BagDoubts(), set(), set()
        step_ns = bag.step_ns(chosen) if deskew else np.inf
        # Odometry goes from scan to scan, so it sees those too that are left out.
        for index, stamp_ns, message in bag.scans(chosen, every) if finder else track(bag.scans(chosen), FINDING, bag.counts[chosen]):
            frame = message.header.frame_id.lstrip("/")
            with named(f"{path}, a message of {chosen}"):
                cloud = without_zeros(READERS[message.__msgtype__](message))
            with named(str(path)):
                pose = finder.at(frame, stamp_ns) if finder else None
            cloud = finder.as_seen(frame, stamp_ns, cloud) if finder else cloud
            start = beam_origins(cloud)
            lengths = beam_lengths(cloud, start).round(4)  # as ranges are: made of float32, some of a code's are a little shorter
            clipped.see(lengths)
            kept = found.within(lengths)
            turns = deskew and not (finder and frame in finder.registered)  # a SLAM has turned their beams back already
            times = beam_times(message, stamp_ns, np.isfinite(lengths), step_ns) if turns else None
            if not finder:
                with named(str(path)):
                    cloud, start = kiss.deskewed(cloud, start, times, stamp_ns)
                    pose = kiss.register(cloud[kept])
            if index % every:
                continue
            doubts.seen += 1
            doubts.untimed += turns and times is None and len(kept) > 0 and says_times(message)
            if pose is None:
                doubts.unposed_ns[frame].append(stamp_ns)
                continue
            if is_flat and leans(pose):
                doubts.tilted += 1
                continue
            frames.add(frame)
            poses_seen.add(tuple(np.round(pose[:3], 3).flat))
            if finder and times is not None and np.ptp(times):
                back = deskewed_along(cloud, start, stamp_ns + times, partial(finder.at, frame), pose)
                doubts.unturned += back is None
                cloud, start = back or (cloud, start)
            found.add(cloud, start, kept, pose, DIMENSIONS[bag.types[chosen]])
    found.warn(path)
    kiss.warn(path)
    clipped.warn(path)
    doubts.warn(path, chosen, finder)
    if finder:
        _warn_of_fixed_clouds(path, chosen, frames - finder.registered.keys(), len(poses_seen), len(found), bag)
    return found.whole(path, doubts.seen, f" on {chosen}")


def _warn_of_fixed_clouds(path: Path, topic: str, frames: set[str], poses: int, found: int, bag: OpenedBag) -> None:
    """Clouds that a SLAM has put in its own fixed frame carry no place of the sensor: all of their beams would start at one, where no
    odometry has that frame."""
    stands = sorted(frames & STANDING)
    if stands or (frames and poses == 1 and found >= 5):
        others = ", ".join(name for name in bag.scan_topics() if name != topic) or "none"
        said = f"are in the frame {stands[0]}, which stands still" if stands else f"come from one place, all {found} of them"
        warnings.warn(
            f"{path}: the scans of {topic} {said}: if the sensor moved, their beams start in the wrong place. Set reading.topic to the "
            f"sensor's own; other topics of scans: {others}",
            stacklevel=3,
        )
