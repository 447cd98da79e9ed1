"""Networks that learned from streets, asked to fill rooms: scores in the gaps of simulated floors that a robot scans in space.

    python benchmarks/rooms.py [--scans 12] [--quick]

No network was trained on rooms in space, and no real scans of any are at hand. Floors are plans of simulated buildings, one of each style
(`simulate/floor_plan.py`), here with a ceiling, walls up to it and furniture of several heights; a lidar of a real model stands 0.7 m above
the floor. Gaps are those of the protocol, 2.5 m, and so are scores, of voxels by maps for voxels and of points by maps for points. Simpler
than any real room: of things that hang, stand on others or are thin there are none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from measuring import arguments, report

from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scans.scan import Scans
from hilbertvae.scoring.protocol import evaluate_all
from hilbertvae.scoring.protocol_settings import Protocol
from hilbertvae.simulate.drive import drive, poses_along
from hilbertvae.simulate.floor_plan import FloorPlan, draw_floor_plan
from hilbertvae.simulate.free_space import find_free_space
from hilbertvae.simulate.laser import extrude
from hilbertvae.simulate.shapes import edges
from hilbertvae.simulate.soup import Soup, Surface, joined, quads, soup
from hilbertvae.simulate.spinning_lidar import SENSORS, SpinningLidar, rays, sense_turn
from hilbertvae.simulate.surfaces import SurfaceCaster
from hilbertvae.site import Site

FLOORS = (("corridors", "vlp16", 4), ("enfilade", "os1", 2), ("hall", "vlp16", 3))
"""Style, sensor and seed."""
NETWORKS = ("3d", "3d-sim")
RESOLUTION_M = 0.2
EXTENT_M, STEP_M, TURN_DEG = 30.0, 1.5, 40.0
CEILING_M = (2.5, 3.5)
FURNITURE_M = (0.45, 0.75, 0.75, 1.2, 1.8, 2.0)
"""Heights: of a seat, tables, a counter, shelves."""
LARGEST_M2 = 6.0
"""A larger solid is a wall, and reaches the ceiling."""
SENSOR_M, CLEARANCE_M, POSE_NOISE_M = 0.7, 0.3, 0.01
ROUTES = 20
SCORES = ("auc", "best_f1", "nll", "ece")


def scene(rng: np.random.Generator, plan: FloorPlan) -> Soup:
    """A floor in space: its solids as prisms, panes, the ground and a ceiling."""
    ceiling = rng.uniform(*CEILING_M)
    tall = np.array([solid.area > LARGEST_M2 for solid in plan.solids])
    heights = np.where(tall, ceiling, rng.choice(FURNITURE_M, len(tall)))
    parts = [prism(solid, height, not wall) for solid, height, wall in zip(plan.solids, heights, tall, strict=True)]
    parts += [sides(pane, ceiling, Surface.PANE) for pane in plan.glass]
    bounds = np.array([solid.bounds for solid in plan.solids])
    (x0, y0), (x1, y1) = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    for height in (0.0, ceiling):
        parts.append(quads([[x0, y0, height], [x1, y0, height], [x1, y1, height], [x0, y1, height]], Surface.WALL))
    return joined(parts)


def sides(polygon, height: float, surface: Surface) -> Soup:
    """Upright faces over a polygon's edges."""
    vertices, faces = extrude(edges([polygon]), 0.0, height)
    return soup(vertices[faces], surface)


def prism(polygon, height: float, lid: bool) -> Soup:
    """A solid's sides, and what closes it above: of furniture, which is convex or nearly."""
    if not lid:
        return sides(polygon, height, Surface.WALL)
    rim = np.array(polygon.convex_hull.exterior.coords)[:-1, :2]
    fan = np.stack([np.broadcast_to(rim.mean(axis=0), rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)
    top = np.concatenate([fan, np.full((len(fan), 3, 1), height)], axis=2)
    return joined([sides(polygon, height, Surface.WALL), soup(top, Surface.WALL)])


def scan_floor(style: str, lidar: SpinningLidar, seed: int, scans: int) -> Scans:
    """What a lidar on a robot returns that drives through a floor."""
    rng = np.random.default_rng(seed)
    for _ in range(ROUTES):
        plan = draw_floor_plan(rng, EXTENT_M, style)
        way = drive(rng, plan, find_free_space(plan), CLEARANCE_M, scans * STEP_M)
        if len(way) >= 2 and len(places := poses_along(rng, way, STEP_M, TURN_DEG, scans)) == scans:
            break
    else:
        raise SystemExit(f"{style}: no way of {scans} scans in {ROUTES} floors")
    caster, beams = SurfaceCaster(scene(rng, plan)), rays(lidar)
    bias, nothing = rng.normal(0, lidar.laser_bias_m, lidar.lasers), np.zeros((lidar.azimuths, lidar.lasers), bool)
    points, origins, scan, beam = [], [], [], []
    for number, (x, y, heading) in enumerate(places):
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
        pose[:3, 3] = x, y, lidar.height_m
        ranges = sense_turn(rng, lidar, beams, [caster], pose, bias, nothing)
        azimuth, laser = np.nonzero(np.isfinite(ranges))
        start, way = (part[azimuth, laser] @ pose[:3, :3].T for part in beams)
        origins.append(start + pose[:3, 3] + rng.normal(0, POSE_NOISE_M, 3))
        points.append(origins[-1] + ranges[azimuth, laser, None] * way)
        scan.append(np.full(len(azimuth), number, np.int32))
        beam.append((azimuth * lidar.lasers + laser).astype(np.int32))
    return Scans(*map(np.concatenate, (points, origins, scan, beam)))


def scored(site: Site, networks: tuple[str, ...], seeds: list[int]) -> list[dict]:
    """A row per method: its scores in gaps, voxels and points, means over gap seeds."""
    ours = {(name, reading): load_mapper(name).set_params(calibration=reading) for name in networks for reading in ("voxels", "points")}
    others = {"15 nearest neighbours": NearestMapper(15), "Hilbert Map (fixed grid)": FixedGridMapper(epochs=3)}
    mappers = {f"{name}, {reading}": mapper for (name, reading), mapper in ours.items()} | others
    found = evaluate_all(mappers, site, Protocol(gap_seeds=seeds, occlusion=False)).scores
    rows = []
    for name in (*networks, *others):
        row = {"floor": site.name, "method": name}
        for reading in ("voxels", "points"):
            gaps = found[f"{name}, {reading}" if name in networks else name][reading]["gaps"]
            row |= {f"{reading}: {score}": float(np.mean(gaps[score])) for score in SCORES}
        rows.append(row)
    return rows


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--scans", type=int, default=12)
    given = parser.parse_args(words)
    floors, networks, seeds = (FLOORS[1:2], NETWORKS[1:], [0]) if given.quick else (FLOORS, NETWORKS, [0, 1])
    rows, facts = [], {}
    for style, sensor, seed in floors:
        lidar = replace(SENSORS[sensor], height_m=SENSOR_M, nearest_m=0.5, car=(), posts=0, azimuths=90 if given.quick else 900)
        site = Site(style, scan_floor(style, lidar, seed, 3 if given.quick else given.scans), RESOLUTION_M)
        extent = np.ptp(site.scans.points, axis=0).round(1).tolist()
        facts[style] = {"sensor": sensor, "seed": seed, "returns": len(site.scans), "extent_m": extent}
        facts[style]["occupied share of voxels"] = float(site.voxels.occupied.mean())
        rows += scored(site, networks, seeds)
    report("rooms", given, rows, [], facts | {"gap_seeds": seeds})


if __name__ == "__main__":
    main()
