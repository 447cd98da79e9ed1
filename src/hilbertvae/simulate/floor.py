"""Simulated floors: a storey of a building in space, scanned by a lidar on a robot or in somebody's hands."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.scan import Scans
from hilbertvae.simulate.building import STYLES
from hilbertvae.simulate.lidar_drive import rotations, scan_along
from hilbertvae.simulate.shares import picked
from hilbertvae.simulate.spinning_lidar import SENSORS, SpinningLidar

if TYPE_CHECKING:  # which draws floors as well as streets
    from hilbertvae.simulate.street import StreetSettings

SENSORS_INDOORS = {"vlp16": 0.25, "vlp32": 0.1, "hdl32": 0.1, "os1": 0.15, "os1_128": 0.1, "os0": 0.2, "mid360": 0.1}
"""Shares of lidars of floors."""
EXTENT_M = (15.0, 50.0)
NEAREST_M = 0.5
"""Closer returns are cut, as robots and hands are; less than that of streets."""
IN_HANDS = 0.5
"""Share of lidars in somebody's hands or on a back; others are on robots."""
CLEARANCE_M = 0.3
ATTEMPTS = 20


def simulate_floor(settings: StreetSettings, seed: int) -> Scans:
    """The scans of one random floor, upright, from where the first scan was made. Of `settings` count the sensor, scans, steps, noise and
    ranges, `nearest_m` at most 0.5 m. The same settings and seed give the same bits.

    Raises `InputError` where no floor with a way for two scans comes of these settings, or where nothing at all came back.
    """
    import shapely

    from hilbertvae.simulate.drive import drive, poses_along
    from hilbertvae.simulate.free_space import find_free_space
    from hilbertvae.simulate.interior import draw_interior

    for attempt in range(ATTEMPTS):
        for_plan, for_drive, for_laser = (np.random.default_rng([seed, attempt, 10 + part]) for part in range(3))
        style = picked(for_plan, STYLES)
        one = settings.scans == 1 or for_drive.random() < settings.single_scan_share
        scans = 1 if one else int(for_drive.integers(2, settings.scans + 1))
        step_m = for_drive.uniform(settings.shortest_step_m, settings.longest_step_m)
        try:
            plan, scene = draw_interior(for_plan, for_plan.uniform(*EXTENT_M), style)
        except shapely.errors.GEOSException:
            continue  # as of buildings in the plane: some outlines no overlay can take
        way = drive(for_drive, plan, find_free_space(plan), CLEARANCE_M, max(scans * step_m, 5.0))
        if len(way) < 2 or len(places := poses_along(for_drive, way, step_m, np.inf, scans)) < min(scans, 2):
            continue
        in_hands = bool(for_drive.random() < IN_HANDS)
        lidar = _draw_lidar(for_laser, settings, in_hands)
        poses = _poses(for_drive, places, lidar.height_m, in_hands)
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = rotations(np.array([[0, 0, places[0, 2]]]))[0], poses[0, :3, 3]
        return scan_along(for_laser, lidar, scene, poses, frame, (settings.pose_noise_m, settings.heading_noise_deg))
    raise InputError(f"street: no floor that can be walked through in {ATTEMPTS} attempts with seed {seed}")


def _draw_lidar(rng, settings: StreetSettings, in_hands: bool) -> SpinningLidar:
    """A lidar without a car, as high as it is carried; robots hide what their posts do, and a head hides a sector."""
    lidar = SENSORS[settings.sensor if settings.sensor != "any" else picked(rng, SENSORS_INDOORS)]
    coarser = int(rng.choice([1, 2]))
    return replace(
        lidar,
        azimuths=settings.azimuths or lidar.azimuths // coarser,
        max_range_m=settings.max_range_m or lidar.max_range_m,
        height_m=rng.uniform(1.1, 1.9) if in_hands else rng.uniform(0.3, 1.0),
        faintest=lidar.faintest * rng.choice([0.6, 1.0, 1.8]),
        range_noise_m=lidar.range_noise_m if settings.range_noise_m is None else settings.range_noise_m,
        nearest_m=min(settings.nearest_m, NEAREST_M),
        car=((180, 90, rng.uniform(15, 40), 5),) if in_hands else (),
        posts=0 if in_hands else 4,
    )


def _poses(rng, places: np.ndarray, height_m: float, in_hands: bool) -> np.ndarray:
    """(S, 4, 4): on the way, more or less upright."""
    count, tilt_deg = len(places), 5.0 if in_hands else 0.7
    poses = np.tile(np.eye(4), (count, 1, 1))
    tilts = np.deg2rad(rng.normal(0, tilt_deg, (count, 2)))
    poses[:, :3, :3] = rotations(np.column_stack([tilts, places[:, 2]]))
    poses[:, :2, 3] = places[:, :2]
    poses[:, 2, 3] = height_m + rng.normal(0, 0.04 if in_hands else 0.0, count)
    return poses
