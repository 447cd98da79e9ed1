"""Simulated buildings: a floor plan, a drive through it and a laser give scans, as the log of a real building does."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive, check_whole
from hilbertvae.scans.scan import Scans
from hilbertvae.simulate.building_variety import VARIETIES, check_variety, draw_extent_m, draw_laser
from hilbertvae.simulate.laser import LaserSettings, RayCaster, bearings, check_sim_extra, extrude, sense, sim_extra
from hilbertvae.simulate.pose_errors import wandering

STYLES = {"corridors": 0.6, "hall": 0.22, "enfilade": 0.18}
"""Shares of the styles among buildings of style "any": about those of the sites that robots were driven through."""

ATTEMPTS = 20

MOST_EXTENT_M = 1000.0
"""Longer buildings are refused: their rasters of free space would take the memory of the machine."""


@dataclass(frozen=True)
class BuildingSettings:
    """What buildings are drawn, and how they are scanned.

    style: a key of `layouts.LAYOUTS`, or "any".
    shortest_extent_m, longest_extent_m: about how long the building is, from 6 to 1000.
    scans: at most so many sweeps; a drive takes one every 0.4 to 1.1 m or 20 to 40 degrees.
    clearance_m: how far the robot keeps from everything solid.
    pose_noise_m, heading_noise_deg: spread of the slowly wandering error of the poses, as a SLAM system leaves them;
    a third of the buildings have 0.6 times as much, a third one and a half times.
    sweeps_per_passer_by: one walks past in so many sweeps, in some buildings in four times as many; inf for nobody.
    draw_laser: another robot's laser in each building: once or twice the beams of `laser`, 0.85, 1 or 1.3 times its longest range,
    and other noise, misses and mixing at edges; else `laser` as it stands.
    variety: a key of `VARIETIES`. "usual": buildings and lasers as these settings say. "wide": also smaller buildings, and, with
    `draw_laser`, lasers of other kinds.
    """

    style: str = "any"
    shortest_extent_m: float = 30.0
    longest_extent_m: float = 95.0
    scans: int = 700
    clearance_m: float = 0.2
    pose_noise_m: float = 0.02
    heading_noise_deg: float = 0.25
    sweeps_per_passer_by: float = 6.0
    draw_laser: bool = True
    laser: LaserSettings = field(default_factory=LaserSettings)
    variety: str = "usual"

    def __post_init__(self):
        if not isinstance(self.style, str) or self.style not in ("any", *STYLES):
            raise InputError(f'building.style: expected "any" or one of {", ".join(STYLES)}, got {self.style!r}')
        check_variety(self.variety, "building.variety")
        each = self.sweeps_per_passer_by
        if isinstance(each, bool) or not isinstance(each, (int, float, np.number)) or not each >= 1:
            raise InputError(f"building.sweeps_per_passer_by: expected at least 1, or inf for nobody, got {each!r}")
        for name in ("shortest_extent_m", "longest_extent_m", "clearance_m"):
            check_positive(getattr(self, name), f"building.{name}")
        if not 6 <= self.shortest_extent_m <= self.longest_extent_m:
            raise InputError(
                "building.shortest_extent_m: expected at least 6 and at most longest_extent_m "
                f"({self.longest_extent_m!r}), got {self.shortest_extent_m!r}"
            )
        if self.longest_extent_m > MOST_EXTENT_M:
            raise InputError(f"building.longest_extent_m: expected at most {MOST_EXTENT_M:g}, got {self.longest_extent_m!r}")
        check_count(self.scans, "building.scans")
        for name in ("pose_noise_m", "heading_noise_deg"):
            check_not_negative(getattr(self, name), f"building.{name}")
        if not isinstance(self.draw_laser, (bool, np.bool_)):
            raise InputError(f"building.draw_laser: expected true or false, got {self.draw_laser!r}")
        if not isinstance(self.laser, LaserSettings):
            raise InputError(f"building.laser: expected LaserSettings, got {self.laser!r}")


def simulate_building(settings: BuildingSettings, seed: int) -> Scans:
    """The scans of one random building in the plane. The same settings and seed give the same bits.

    Raises `InputError` where the extra `sim` is not installed, where no drivable building comes of these settings, or where nothing at all
    came back.
    """
    check_whole(seed, "seed")
    check_sim_extra()
    shapely = sim_extra("shapely")
    from hilbertvae.simulate.drive import drive, poses_along
    from hilbertvae.simulate.floor_plan import draw_floor_plan
    from hilbertvae.simulate.free_space import find_free_space

    variety = VARIETIES[settings.variety]
    for attempt in range(ATTEMPTS):
        for_plan, for_drive, for_laser, for_variety = (np.random.default_rng([seed, attempt, part]) for part in range(4))
        style = settings.style if settings.style != "any" else for_plan.choice(list(STYLES), p=list(STYLES.values()))
        extent_m = draw_extent_m(for_plan, for_variety, variety, settings.shortest_extent_m, settings.longest_extent_m)
        try:
            plan = draw_floor_plan(for_plan, extent_m, style)
        except shapely.errors.GEOSException:
            continue  # about 1 plan in 500 has outlines that no overlay can take; the next attempt draws another
        step_m, turn_deg = for_drive.uniform(0.4, 1.1), for_drive.uniform(20, 40)
        space = find_free_space(plan)
        way = drive(for_drive, plan, space, settings.clearance_m, settings.scans * step_m)
        if len(way) < 2:
            continue
        poses = poses_along(for_drive, way, step_m, turn_deg, settings.scans)
        if len(poses) >= min(settings.scans, int(4 * min(extent_m, settings.shortest_extent_m))):
            laser = draw_laser(for_laser, for_variety, variety, settings.laser) if settings.draw_laser else settings.laser
            return scan_from_poses(for_laser, plan, space, poses, laser, settings)
    raise InputError(
        f"building: no drivable building in {ATTEMPTS} attempts with seed {seed}; allow a longer extent, less clearance or fewer scans"
    )


def scan_from_poses(rng: np.random.Generator, plan, space, poses: np.ndarray, laser: LaserSettings, settings: BuildingSettings) -> Scans:
    """What `laser` at `poses` (S, 3; metres, radians) reports of `plan`, placed where a SLAM system believes it is."""
    from hilbertvae.simulate.passers_by import draw_passers_by
    from hilbertvae.simulate.shapes import edges

    solid, glass = (RayCaster(*extrude(edges(polygons))) for polygons in (plan.solids, plan.glass))
    origins, directions = _beams(poses, laser)
    people = draw_passers_by(rng, poses, space, settings.sweeps_per_passer_by * rng.choice([1.0, 4.0]))
    ranges = sense(rng, laser, solid, glass, origins, directions, people.ranges(origins, directions))
    believed_origins, believed_directions = _beams(_believed(rng, poses, settings), laser)
    scan, beam = np.nonzero(np.isfinite(ranges))
    if len(scan) == 0:
        raise InputError(
            f"building.laser: expected returns within {laser.max_range_m:g} m, got none in {len(poses)} scans; "
            "allow a longer max_range_m or a smaller miss_share"
        )
    points = believed_origins[scan, beam] + ranges[scan, beam, None] * believed_directions[scan, beam]
    return Scans(points, believed_origins[scan, beam], scan.astype(np.int32), beam.astype(np.int32))


def _beams(poses: np.ndarray, laser: LaserSettings) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions, both (S, B, 2), of all beams of a level laser."""
    angles = poses[:, 2:] + bearings(laser)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.broadcast_to(poses[:, None, :2], directions.shape), directions


def _believed(rng, poses: np.ndarray, settings: BuildingSettings) -> np.ndarray:
    """Poses with an error that wanders."""
    shocks = (
        rng.normal(size=poses.shape)
        * rng.choice([0.6, 1.0, 1.5])
        * [settings.pose_noise_m, settings.pose_noise_m, np.deg2rad(settings.heading_noise_deg)]
    )
    return poses + wandering(shocks)
