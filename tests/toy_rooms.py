"""Small rooms seen by a sensor, a CARMEN log of one, and tiny networks: what many tests share."""

import gzip

import numpy as np
import torch

from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import GatedNetworkSettings, LikelihoodSettings
from hilbertvae.scans.scan import Scans

CENTRE = np.array([1.3, -2.7])
"""Away from the origin, so that a mixed-up sign shows."""
SIDE_M, PILLAR_M, HEIGHT_M = 8.0, 1.0, 3.0


def cast(origins, directions, room, pillar):
    """Ranges (N,) from inside the box `room` (low, high) to its walls or to the box `pillar`, whichever comes first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(directions > 0, room[1] - origins, room[0] - origins) / directions
        sides = np.stack([(pillar[0] - origins) / directions, (pillar[1] - origins) / directions])
    wall = np.where(directions == 0, np.inf, far).min(axis=1)
    enter, leave = np.nanmax(sides.min(axis=0), axis=1), np.nanmin(sides.max(axis=0), axis=1)
    return np.where((enter <= leave) & (enter > 0), np.minimum(enter, wall), wall)


def _scans(directions, dimension, sweeps, noise_m, seed):
    """A drive around the pillar; every sweep sends the beams `directions (B, D)`."""
    rng = np.random.default_rng(seed)
    half, thin = np.full(dimension, SIDE_M / 2), np.full(dimension, PILLAR_M / 2)
    middle = np.append(CENTRE, HEIGHT_M / 2)[:dimension]
    half[2:], thin[2:] = HEIGHT_M / 2, HEIGHT_M
    around = 2 * np.pi * np.arange(sweeps) / sweeps
    places = np.column_stack([CENTRE + 2.4 * np.column_stack([np.cos(around), np.sin(around)]), np.full(sweeps, 1.23)])[:, :dimension]
    origins, directions = np.repeat(places, len(directions), axis=0), np.tile(directions, (sweeps, 1))
    ranges = cast(origins, directions, (middle - half, middle + half), (middle - thin, middle + thin))
    ranges = ranges + rng.normal(0, noise_m, len(ranges))
    scan, beam = np.divmod(np.arange(len(ranges), dtype=np.int32), np.int32(len(ranges) // sweeps))
    return Scans(origins + ranges[:, None] * directions, origins, scan, beam)


def square_room(sweeps=20, beams=180, noise_m=0.01, seed=0) -> Scans:
    """A room of 8 x 8 m with a square pillar in its middle, seen all around from a circle about the pillar."""
    angle = 2 * np.pi * np.arange(beams) / beams + 0.001
    return _scans(np.column_stack([np.cos(angle), np.sin(angle)]), 2, sweeps, noise_m, seed)


def box_room(sweeps=9, beams=60, noise_m=0.01, seed=0) -> Scans:
    """The same in 3D: floor, ceiling at 3 m, and nine rings of beams from 40 degrees down to 40 up."""
    angle, rise = np.meshgrid(2 * np.pi * np.arange(beams) / beams + 0.001, np.deg2rad(np.linspace(-40, 40, 9)))
    angle, rise = angle.ravel(), rise.ravel()
    directions = np.column_stack([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])
    return _scans(directions, 3, sweeps, noise_m, seed)


def carmen_line(ranges, pose, command="FLASER") -> str:
    """One line of a CARMEN log: the ranges, the corrected pose, the odometry's pose, and three fields on time and host."""
    numbers = " ".join(f"{value:.9f}" for value in [*ranges, *pose, 0.0, 0.0, 0.0])
    return f"{command} {len(ranges)} {numbers} 1.0 host 1.0\n"


def write_log(path, lines):
    """`lines` at `path`, gzipped if it ends in .gz."""
    with gzip.open(path, "wt") if path.suffix == ".gz" else open(path, "w") as file:
        file.write("# message_name [message contents]\nPARAM robot_front_laser_max 81.9 1.0 host 1.0\n" + "".join(lines))
    return path


def tiny_grid(dimension=2, cells=16) -> GridSettings:
    """Boxes of 16 voxels a side."""
    return GridSettings(cells=cells, cluster_diameter_m=cells * {2: 0.1, 3: 0.2}[dimension], inner_radius_m=0.5, minimum_points=3)


def tiny_reconstructor(dimension=2, seed=0, **network) -> Reconstructor:
    """A network that was never trained, with all weights drawn (residual blocks start at zero, and would hide mistakes)."""
    torch.manual_seed(seed)
    settings = GatedNetworkSettings(**{"stem": 2, "channels": [4, 8], "blocks": [1, 1], "latent": 3, **network})
    grid = tiny_grid(dimension)
    made = build_network(settings, dimension, grid.cells)
    draw_weights(made)
    return Reconstructor(made, settings, LikelihoodSettings(), grid, dimension, {2: 0.1, 3: 0.2}[dimension])


def draw_weights(network) -> None:
    """Weights without zeros, in place."""
    with torch.no_grad():
        for parameter in network.parameters():
            if not parameter.any():
                parameter.normal_(0, 0.1)


def room_log(path, sweeps=12, seed=0):
    """A CARMEN log of a drive around the pillar of the square room, one beam per degree, at `path`."""
    rng = np.random.default_rng(seed)
    half, thin, lines = SIDE_M / 2, PILLAR_M / 2, []
    for sweep in range(sweeps):
        around = 2 * np.pi * (sweep + rng.random()) / sweeps
        place, heading = CENTRE + 2.4 * np.array([np.cos(around), np.sin(around)]), around + np.pi / 2
        angle = heading + np.deg2rad(np.arange(180) - 90)
        directions = np.column_stack([np.cos(angle), np.sin(angle)])
        ranges = cast(np.tile(place, (180, 1)), directions, (CENTRE - half, CENTRE + half), (CENTRE - thin, CENTRE + thin))
        lines.append(carmen_line(ranges + rng.normal(0, 0.01, 180), [*place, heading]))
    return write_log(path, lines)
