"""What a spinning lidar returns on its way through a scene, placed where scan matching believes that it was."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.scan import Scans
from hilbertvae.simulate.pose_errors import wandering
from hilbertvae.simulate.soup import Soup
from hilbertvae.simulate.spinning_lidar import SpinningLidar, hidden_by_car, rays, sense_turn
from hilbertvae.simulate.surfaces import SurfaceCaster


def scan_along(
    rng: np.random.Generator,
    lidar: SpinningLidar,
    still: Soup,
    poses: np.ndarray,
    frame: np.ndarray,
    noise: tuple[float, float],
    moving: Callable[[int], Soup] | None = None,
) -> Scans:
    """One scan at each of `poses` (S, 4, 4), sensor to world, in the frame (4, 4) of the world that maps are to have.

    still: the scene, in the world. moving: what else is there in scan k. noise: spread of the slowly wandering error of the poses,
    metres along each axis and degrees about each.

    Raises `InputError` where nothing at all came back.
    """
    caster, beams = SurfaceCaster(still), rays(lidar)
    hidden = hidden_by_car(rng, lidar)
    bias = rng.normal(0, lidar.laser_bias_m, lidar.lasers)
    believed = np.linalg.inv(frame) @ poses @ _errors(rng, len(poses), *noise)
    points, origins, scan, beam = [], [], [], []
    for k, pose in enumerate(poses):
        others = moving(k) if moving else ()
        casters = [caster, SurfaceCaster(others)] if len(others) else [caster]
        ranges = sense_turn(rng, lidar, beams, casters, pose, bias, hidden)
        azimuth, laser = np.nonzero(np.isfinite(ranges))
        start, way = (part[azimuth, laser] for part in beams)
        origin = start @ believed[k, :3, :3].T + believed[k, :3, 3]
        origins.append(origin)
        points.append(origin + ranges[azimuth, laser, None] * (way @ believed[k, :3, :3].T))
        beam.append(azimuth * lidar.lasers + laser)
        scan.append(np.full(len(azimuth), k))
    if not any(map(len, points)):
        wanted = f"returns from {lidar.nearest_m:g} to {lidar.max_range_m:g} m"
        raise InputError(f"street: expected {wanted}, got none in {len(poses)} scans; allow a longer max_range_m or a smaller nearest_m")
    return Scans(
        np.concatenate(points), np.concatenate(origins), np.concatenate(scan).astype(np.int32), np.concatenate(beam).astype(np.int32)
    )


def _errors(rng, count: int, noise_m: float, noise_deg: float) -> np.ndarray:
    """(S, 4, 4): small motions that wander; none in the first."""
    shocks = rng.normal(size=(count, 6)) * ([noise_m] * 3 + [np.deg2rad(noise_deg)] * 3) * rng.choice([0.6, 1.0, 1.5])
    shocks[0] = 0
    error = wandering(shocks)
    motions = np.tile(np.eye(4), (count, 1, 1))
    motions[:, :3, :3] = rotations(error[:, 3:])
    motions[:, :3, 3] = error[:, :3]
    return motions


def rotations(angles: np.ndarray) -> np.ndarray:
    """(S, 3, 3): turns by roll, pitch and heading (S, 3), radians."""
    roll, pitch, yaw = angles.T
    zero, one = np.zeros_like(roll), np.ones_like(roll)
    matrices = [
        [[np.cos(yaw), -np.sin(yaw), zero], [np.sin(yaw), np.cos(yaw), zero], [zero, zero, one]],
        [[np.cos(pitch), zero, np.sin(pitch)], [zero, one, zero], [-np.sin(pitch), zero, np.cos(pitch)]],
        [[one, zero, zero], [zero, np.cos(roll), -np.sin(roll)], [zero, np.sin(roll), np.cos(roll)]],
    ]
    about_z, about_y, about_x = (np.moveaxis(np.array(matrix), 2, 0) for matrix in matrices)
    return about_z @ about_y @ about_x
