"""Simulated streets: a street, a drive along it and a spinning lidar give scans, as those of a real car do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive, check_share, check_whole
from hilbertvae.scans.scan import Scans
from hilbertvae.simulate.laser import check_sim_extra
from hilbertvae.simulate.lidar_drive import rotations, scan_along
from hilbertvae.simulate.shares import picked
from hilbertvae.simulate.spinning_lidar import SENSORS, SpinningLidar
from hilbertvae.simulate.street_variety import VARIETIES, Mount, draw_character, draw_mount, hilly

CHARACTERS = tuple(VARIETIES["usual"].characters)
"""The kinds of streets."""

LEVEL_DEG = (0.2, 0.3)
"""Spread of the roll and the pitch at which a sensor is mounted on a car, unless its mount has another."""

MOST_DRIVE_M = 500.0
"""Longer drives are refused: the sharpest of streets would come round to where it began."""


@dataclass
class StreetSettings:
    """What streets are drawn, and how they are scanned.

    variety: a key of `VARIETIES`. "usual": streets of cars as KITTI's and nuScenes'. "wide": also other sensors, on robots and tilted,
    more paths and open land, on more uneven ground. "floors": no streets, but floors of buildings (`floor.py`);
    "everywhere": every other one a floor, the others wide streets.
    character: one of `CHARACTERS`, or "any". sensor: a key of `spinning_lidar.SENSORS`, or "any": another one per site.
    azimuths, max_range_m, range_noise_m: firings in a turn, longest range and spread of ranges; None for the sensor's own.
    single_scan_share: of sites, those of one scan only; the others have 2 to `scans` scans, `shortest_step_m` to `longest_step_m` apart,
    over a drive of at most 500 m.
    pose_noise_m, heading_noise_deg: spread of the slowly wandering error of the poses, as scan matching leaves it; the second is also
    that of roll and pitch.
    nearest_m: closer returns are cut, as the car itself is; on floors at most 0.5.
    traffic: whether anything moves between scans; on floors nothing does.

    A street is drawn as long and as wide as its drive and the lidar's range ask for: other scans, steps or max_range_m are another
    street, not the same one scanned otherwise.
    """

    character: str = "any"
    sensor: str = "any"
    azimuths: int | None = None
    max_range_m: float | None = None
    scans: int = 30
    single_scan_share: float = 0.5
    shortest_step_m: float = 0.5
    longest_step_m: float = 3.0
    pose_noise_m: float = 0.012
    heading_noise_deg: float = 0.05
    range_noise_m: float | None = None
    nearest_m: float = 2.5
    traffic: bool = True
    variety: str = "usual"

    def __post_init__(self):
        if not isinstance(self.variety, str) or self.variety not in VARIETIES:
            raise InputError(f"street.variety: expected one of {', '.join(VARIETIES)}, got {self.variety!r}")
        if self.character not in ("any", *CHARACTERS):
            raise InputError(f'street.character: expected "any" or one of {", ".join(CHARACTERS)}, got {self.character!r}')
        if self.character != "any" and VARIETIES[self.variety].floors == 1:
            raise InputError(f'street.character: expected "any" where sites are floors, not streets, got {self.character!r}')
        if self.sensor not in ("any", *SENSORS):
            raise InputError(f'street.sensor: expected "any" or one of {", ".join(SENSORS)}, got {self.sensor!r}')
        check_count(self.scans, "street.scans")
        if self.azimuths is not None:
            check_count(self.azimuths, "street.azimuths", least=4)
        check_share(self.single_scan_share, "street.single_scan_share")
        for name in ("shortest_step_m", "longest_step_m", "nearest_m"):
            check_positive(getattr(self, name), f"street.{name}")
        if self.shortest_step_m > self.longest_step_m:
            raise InputError(
                f"street.shortest_step_m: expected at most longest_step_m ({self.longest_step_m!r}), got {self.shortest_step_m!r}"
            )
        if self.single_scan_share < 1 and (self.scans - 1) * self.longest_step_m > MOST_DRIVE_M:
            raise InputError(
                f"street.longest_step_m: expected a drive of at most {MOST_DRIVE_M:g} m, got {self.scans} scans up to "
                f"{self.longest_step_m!r} m apart"
            )
        if self.max_range_m is None:
            of_sensors = [self.sensor] if self.sensor != "any" else VARIETIES[self.variety].sensors
            sees_m = min(SENSORS[sensor].max_range_m for sensor in of_sensors)
            if self.nearest_m >= sees_m:
                raise InputError(f"street.nearest_m: expected less than the sensor's longest range ({sees_m!r}), got {self.nearest_m!r}")
        elif check_positive(self.max_range_m, "street.max_range_m") <= self.nearest_m:
            raise InputError(f"street.max_range_m: expected more than nearest_m ({self.nearest_m!r}), got {self.max_range_m!r}")
        for name in ("pose_noise_m", "heading_noise_deg", "range_noise_m"):
            if getattr(self, name) is None and name == "range_noise_m":
                continue
            check_not_negative(getattr(self, name), f"street.{name}")
        if not isinstance(self.traffic, (bool, np.bool_)):
            raise InputError(f"street.traffic: expected true or false, got {self.traffic!r}")


def simulate_street(settings: StreetSettings, seed: int) -> Scans:
    """The scans of one random street, in the frame of the first scan's sensor, or of one floor, upright.

    The same settings and seed give the same bits.

    Raises `InputError` where the extra `sim` is not installed, or where nothing at all came back.
    """
    check_whole(seed, "seed")
    check_sim_extra()
    from hilbertvae.simulate.floor import simulate_floor
    from hilbertvae.simulate.street_filling import add_traffic, fill
    from hilbertvae.simulate.street_plan import BEYOND_M, draw_street_plan

    for_plan, for_things, for_drive, for_laser, for_variety = (np.random.default_rng([seed, part]) for part in range(5))
    variety = VARIETIES[settings.variety]
    if variety.floors and for_variety.random() < variety.floors:
        return simulate_floor(settings, seed)
    sensor = settings.sensor if settings.sensor != "any" else picked(for_laser, variety.sensors)
    mount = draw_mount(for_variety, variety)
    lidar = draw_lidar(for_laser, sensor, settings, mount)
    scans = 1 if settings.scans == 1 or for_drive.random() < settings.single_scan_share else int(for_drive.integers(2, settings.scans + 1))
    step_m = for_drive.uniform(settings.shortest_step_m, settings.longest_step_m)
    robot = mount is not None and mount.robot
    character = settings.character if settings.character != "any" else draw_character(for_plan, variety, sensor, robot)
    plan = draw_street_plan(for_plan, character, step_m * (scans - 1), min(BEYOND_M, lidar.max_range_m + 5))
    plan = hilly(for_variety, plan, variety)
    scene = fill(for_things, plan, step_m * (scans - 1))
    lane_s = step_m * np.arange(scans)
    if settings.traffic:
        add_traffic(for_things, scene, step_m, lane_s)
        scene.clear_ways(lane_s)
    else:
        scene.movers.clear()
    poses = draw_poses(for_drive, plan, lane_s, lidar.height_m, (mount.tilt_deg, mount.tilt_deg) if mount else LEVEL_DEG)
    return scan_scene(for_laser, scene, poses, lidar, settings)


def draw_lidar(rng: np.random.Generator, sensor: str, settings: StreetSettings, mount: Mount | None = None) -> SpinningLidar:
    """A sensor of `SENSORS`, mounted some centimetres higher or lower than its own or a given mount, more or less sensitive."""
    lidar = SENSORS[sensor] if mount is None else mount.carrying(SENSORS[sensor])
    noise = lidar.range_noise_m if settings.range_noise_m is None else settings.range_noise_m
    return replace(
        lidar,
        azimuths=settings.azimuths or lidar.azimuths,
        max_range_m=settings.max_range_m or lidar.max_range_m,
        height_m=lidar.height_m + rng.normal(0, 0.03),
        faintest=lidar.faintest * rng.choice([0.6, 1.0, 1.8]),
        range_noise_m=noise,
        nearest_m=settings.nearest_m,
    )


def draw_poses(
    rng: np.random.Generator, plan, lane_s: np.ndarray, height_m: float, tilt_deg: tuple[float, float] = LEVEL_DEG
) -> np.ndarray:
    """(S, 4, 4): sensor to world along the lane, with gentle swerves and the car's pitch and roll on the ground.

    tilt_deg: spread of the roll and the pitch at which the sensor is mounted.
    """
    swerve, phase, length = rng.normal(0, 0.15), rng.uniform(0, 6), rng.uniform(15, 40)

    def lane(s):
        t = plan.lane_t + swerve * np.sin(s / length + phase)
        if plan.island:
            middle, radius = plan.island
            around = (radius + plan.ring_m) / 2
            bend = np.sqrt(np.maximum(around**2 - (s - middle) ** 2, 0)) * np.sign(plan.lane_t)
            t = np.where(np.abs(bend) > np.abs(t), bend, t)
        return t

    ground, reach = plan.ground, 1.3
    s = np.asarray(lane_s, dtype=float)
    place = ground.place(s, lane(s))
    ahead = ground.place(s + reach, lane(s + reach)) - ground.place(s - reach, lane(s - reach))
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    left = ground.place(s, lane(s) + 0.8) - ground.place(s, lane(s) - 0.8)
    left -= (left * ahead).sum(axis=1, keepdims=True) * ahead
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    turn = np.stack([ahead, left, np.cross(ahead, left)], axis=-1) @ rotations(np.deg2rad(rng.normal(0, [*tilt_deg, 0.5], (1, 3))))
    poses = np.tile(np.eye(4), (len(s), 1, 1))
    poses[:, :3, :3] = turn
    poses[:, :3, 3] = place + height_m * turn[:, :, 2]
    return poses


def scan_scene(rng: np.random.Generator, scene, poses: np.ndarray, lidar: SpinningLidar, settings: StreetSettings) -> Scans:
    """What the lidar returns at `poses` (S, 4, 4), placed where scan matching believes it was, relative to the first pose."""
    from hilbertvae.simulate.soup import joined

    s0, _, s1, _ = scene.plan.extent

    def moving(k: int):
        there = (mover.at_scan(k) for mover in scene.movers)
        # oncoming ones start beyond the land
        return joined([thing.in_world(scene.plan.ground) for thing in there if s0 < thing.s < s1])

    return scan_along(rng, lidar, scene.soup(), poses, poses[0], (settings.pose_noise_m, settings.heading_noise_deg), moving)
