"""A spinning lidar on a car's roof: the lasers of real models, the way they turn, and their faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive, check_share, check_whole
from hilbertvae.simulate.laser import mixed_at_edges
from hilbertvae.simulate.surfaces import Echo, SurfaceCaster, echoes

MIXED_M = 1.0
"""Up to such a depth a spinning lidar mixes the two sides of an edge."""


@dataclass(frozen=True)
class SpinningLidar:
    """A sensor. Its frame: x ahead, y left, z up.

    elevations_deg: (L,) from the highest laser down; start_heights_m: (L,) where on the z axis each beam leaves.
    azimuths: firings in a turn. height_m: of the sensor frame above the road. max_range_m: nothing is returned from there on.
    faintest: of a return, brightness over range squared, below which half of the beams are lost. range_noise_m: its spread.
    laser_bias_m: spread of the constant error of each laser. miss_share: beams lost for no visible reason.
    nearest_m: closer returns are cut, as the car itself is. car: where that hides the road, rows of bearing, elevation up to which
    it does, half of how wide, and how gently that ends (all degrees). posts: at most so many bearings are hidden altogether.
    """

    elevations_deg: tuple[float, ...]
    start_heights_m: tuple[float, ...]
    azimuths: int
    height_m: float
    max_range_m: float
    faintest: float
    range_noise_m: float = 0.02
    laser_bias_m: float = 0.005
    miss_share: float = 0.01
    edge_mix_share: float = 0.1
    nearest_m: float = 2.5
    car: tuple[tuple[float, float, float, float], ...] = ()
    posts: int = 0

    def __post_init__(self):
        if len(self.elevations_deg) == 0 or len(self.elevations_deg) != len(self.start_heights_m):
            raise InputError("lidar.elevations_deg: expected at least one laser, and as many as lidar.start_heights_m has")
        for name, most in (("elevations_deg", 90), ("start_heights_m", np.inf)):
            if not all(_is_number(value) and abs(value) <= most for value in getattr(self, name)):
                wanted = "finite numbers" if most == np.inf else f"angles from -{most} to {most}"
                raise InputError(f"lidar.{name}: expected {wanted}, got {getattr(self, name)!r}")
        check_count(self.azimuths, "lidar.azimuths", least=4)
        for name in ("height_m", "max_range_m", "faintest", "nearest_m"):
            check_positive(getattr(self, name), f"lidar.{name}")
        for name in ("range_noise_m", "laser_bias_m"):
            check_not_negative(getattr(self, name), f"lidar.{name}")
        if self.nearest_m >= self.max_range_m:
            raise InputError(f"lidar.nearest_m: expected less than max_range_m ({self.max_range_m!r}), got {self.nearest_m!r}")
        for name in ("miss_share", "edge_mix_share"):
            check_share(getattr(self, name), f"lidar.{name}")
        if not all(len(row) == 4 and all(map(_is_number, row)) and row[2] >= 0 and row[3] > 0 for row in self.car):
            raise InputError(
                f"lidar.car: expected rows of bearing, elevation, half width (from 0 on) and ramp (above 0), degrees, got {self.car!r}"
            )
        check_whole(self.posts, "lidar.posts")

    @property
    def lasers(self) -> int:
        return len(self.elevations_deg)


def _is_number(value) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and bool(np.isfinite(value))


def _steps(first: float, last: float, count: int) -> tuple[float, ...]:
    return tuple(np.linspace(first, last, count).round(3).tolist())


# fmt: off
VLP32_DEG = (15, 10.333, 7, 4.667, 3.333, 2.333, 1.667, 1.333, 1, 0.667, 0.333, 0, -0.333, -0.667, -1, -1.333, -1.667, -2, -2.333, -2.667,
             -3, -3.333, -3.667, -4, -4.667, -5.333, -6.148, -7.254, -8.843, -11.31, -15.639, -25)
"""Lasers of a VLP-32C: closest together where streets are farthest away."""
# fmt: on

SENSORS = {
    "hdl64": SpinningLidar(
        elevations_deg=_steps(1.95, -8.75, 32) + _steps(-9.0, -25.05, 32),
        start_heights_m=(0.20,) * 32 + (0.12,) * 32,
        azimuths=2083,
        height_m=1.73,
        max_range_m=80.0,
        faintest=1.2e-6,
        range_noise_m=0.022,
        laser_bias_m=0.008,
        miss_share=0.006,
        car=((0, -22, 20, 10), (180, -19.5, 20, 12)),
    ),
    "hdl32": SpinningLidar(
        elevations_deg=_steps(10.67, -30.67, 32),
        start_heights_m=(0.0,) * 32,
        azimuths=1090,
        height_m=1.84,
        max_range_m=105.0,
        faintest=2.5e-6,
        range_noise_m=0.012,
        car=((0, -22, 26, 40), (180, -18, 10, 50)),
    ),
    "os1": SpinningLidar(
        elevations_deg=_steps(16.6, -16.6, 64),
        start_heights_m=(0.0,) * 64,
        azimuths=2048,
        height_m=1.45,
        max_range_m=100.0,
        faintest=5e-6,
        range_noise_m=0.02,
        posts=4,
    ),
    "vlp16": SpinningLidar(
        elevations_deg=_steps(15.0, -15.0, 16),
        start_heights_m=(0.0,) * 16,
        azimuths=1800,
        height_m=1.9,
        max_range_m=100.0,
        faintest=3e-6,
        range_noise_m=0.015,
    ),
    "vlp32": SpinningLidar(
        elevations_deg=VLP32_DEG,
        start_heights_m=(0.0,) * 32,
        azimuths=1800,
        height_m=1.9,
        max_range_m=120.0,
        faintest=1.5e-6,
        range_noise_m=0.015,
        car=((0, -22, 26, 40), (180, -18, 10, 50)),
    ),
    "os1_128": SpinningLidar(
        elevations_deg=_steps(22.5, -22.5, 128),
        start_heights_m=(0.0,) * 128,
        azimuths=1024,
        height_m=1.8,
        max_range_m=100.0,
        faintest=4e-6,
        range_noise_m=0.02,
        car=((0, -20, 26, 40), (180, -18, 10, 50)),
    ),
    "os0": SpinningLidar(
        elevations_deg=_steps(45.0, -45.0, 64),
        start_heights_m=(0.0,) * 64,
        azimuths=1024,
        height_m=1.0,
        max_range_m=45.0,
        faintest=2e-5,
        range_noise_m=0.015,
    ),
    "mid360": SpinningLidar(
        elevations_deg=_steps(52.0, -7.0, 41),
        start_heights_m=(0.0,) * 41,
        azimuths=1000,
        height_m=1.0,
        max_range_m=40.0,
        faintest=1.5e-5,
        range_noise_m=0.02,
    ),
}
"""Lasers and hidden roads as measured in real scans: the HDL-64E of KITTI, whose blocks of 1/3 and 1/2 degree leave at two heights;
the HDL-32E of nuScenes' cars; an OS1-64 on a small robot. A VLP-16, a VLP-32C, an OS1-128 and an OS0-64 have the lasers of their makers'
data sheets, and the rest by what those three have. A Mid-360 draws no rings: forty-one of them stand for what a moment
of its pattern covers, not forty: each tenth beam is held out, which would be whole rings."""


def rays(lidar: SpinningLidar) -> tuple[np.ndarray, np.ndarray]:
    """Beam starts and unit directions in the sensor frame, both (azimuths, lasers, 3): clockwise from straight ahead."""
    azimuth = -np.arange(lidar.azimuths) * (2 * np.pi / lidar.azimuths)
    elevation = np.deg2rad(lidar.elevations_deg)
    flat = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    directions = np.empty((lidar.azimuths, lidar.lasers, 3))
    directions[..., :2] = flat[:, None] * np.cos(elevation)[:, None]
    directions[..., 2] = np.sin(elevation)
    starts = np.zeros_like(directions)
    starts[..., 2] = lidar.start_heights_m
    return starts, directions


def hidden_by_car(rng: np.random.Generator, lidar: SpinningLidar) -> np.ndarray:
    """(azimuths, lasers) bool: beams that end on the car that carries the sensor: low ones ahead and behind, and all at its posts."""
    azimuth = -np.arange(lidar.azimuths) * (2 * np.pi / lidar.azimuths)

    def away_deg(bearing_deg):
        return np.abs(np.rad2deg(np.angle(np.exp(1j * (azimuth - np.deg2rad(bearing_deg))))))

    lowest, steepest = np.full(lidar.azimuths, -90.0), min(lidar.elevations_deg) - 1
    for bearing, elevation, half_width, ramp in lidar.car:
        past = np.maximum(away_deg(bearing + rng.normal(0, 1)) - half_width, 0) / ramp
        ragged = np.repeat(rng.normal(0, 0.5, 180), -(-lidar.azimuths // 180))[: lidar.azimuths]
        top = elevation + rng.normal(0, 0.5) + ragged
        lowest = np.maximum(lowest, np.where(past < 1, top + past * (steepest - top), -90))
    for bearing in rng.uniform(0, 360, rng.integers(0, lidar.posts + 1)):
        lowest = np.where(away_deg(bearing) < rng.uniform(1, 5), 90.0, lowest)
    return np.asarray(lidar.elevations_deg) < lowest[:, None]


def sense_turn(
    rng: np.random.Generator,
    lidar: SpinningLidar,
    beams: tuple[np.ndarray, np.ndarray],
    casters: list[SurfaceCaster],
    pose: np.ndarray,
    laser_bias_m: np.ndarray,
    hidden: np.ndarray,
) -> np.ndarray:
    """(azimuths, lasers) metres, NaN where nothing came back: one turn at `pose` (4, 4), sensor to world.

    `beams` are the `rays` of the lidar; the casters' scenes are in the world frame.
    """
    starts, directions = beams
    shape = directions.shape[:2]
    open_beams = np.flatnonzero(~hidden.ravel())
    origins = starts.reshape(-1, 3)[open_beams] @ pose[:3, :3].T + pose[:3, 3]
    echo = echoes(rng, casters, origins, directions.reshape(-1, 3)[open_beams] @ pose[:3, :3].T)
    ranges = np.full(hidden.size, np.inf)
    ranges[open_beams] = _answered(rng, lidar, echo)
    ranges = ranges.reshape(shape)
    in_turn = np.pad(ranges, ((2, 1), (0, 0)), mode="wrap")  # along each laser's turn
    ranges = mixed_at_edges(rng, in_turn, lidar.edge_mix_share, MIXED_M)
    ranges = ranges + rng.normal(0, 1, shape) * lidar.range_noise_m + laser_bias_m
    lost = rng.random(shape) < lidar.miss_share
    return np.where(lost | ~(ranges < lidar.max_range_m) | (ranges <= lidar.nearest_m), np.nan, ranges)


def _answered(rng, lidar: SpinningLidar, echo: Echo) -> np.ndarray:
    """(N,) metres: ranges with the roughness of what was met, inf where too little light came back."""
    with np.errstate(divide="ignore", invalid="ignore"):
        strength = np.log(echo.brightness / echo.ranges**2) - np.log(lidar.faintest)
    seen = rng.random(len(strength)) < 1 / (1 + np.exp(-3 * np.where(np.isfinite(strength), strength, -99)))
    return np.where(seen, echo.ranges + rng.normal(0, 1, len(strength)) * echo.roughness_m, np.inf)
