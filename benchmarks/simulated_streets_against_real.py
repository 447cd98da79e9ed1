"""Do simulated streets look like real ones? A table of numbers, and pictures of both one above the other.

    python benchmarks/simulated_streets_against_real.py [--streets 14] [--first-seed 1000] [--pictures FOLDER]

Compared are the training sites and the validation site only, never a test site; the first scan of each is measured. Real
sites that are not in the data folder (`HILBERTVAE_DATA`, default ../shared/data) are left out. Heights are above the road,
which is the plane under the car. Numbers of one scan:

- returns: how many; range_q10 ... range_q90: their quantiles of range, metres.
- ground: share of returns lower than 0.25 m above the lowest return around (cells of 1 m). h_q50, h_q75, h_q90, h_q97: quantiles
  of height over that. low_2m: of the returns that are not ground, the share lower than 2 m.
- blocked_10, blocked_20: share of 720 bearings with a return 0.5 to 2.5 m high nearer than 10 m and 20 m.
- voxels: occupied voxels of 0.2 m within 25 m, thousands; box_occ: share of occupied ones in boxes of 6.4 m around them.
- rough: of the returns 0.5 m above the ground and within 25 m, the share whose neighbours within 0.4 m fill space instead of a plane
  (leaves); flat: the share on planes (walls, cars).
- jumps: share of neighbouring beams of one ring that differ by more than 0.5 m in range.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from hilbertvae.scans.scan import Scans
from hilbertvae.scans.sites import data_folder
from hilbertvae.simulate.street import StreetSettings, simulate_street

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

SENSOR_TURNS = ("hdl64", "hdl64", "hdl32", "hdl64", "hdl64", "hdl32", "hdl64", "os1")
TEST_SITES = ("kitti_drive0005",)
BEAM_START_M = {"hdl64": 0.16, "hdl32": 0.0, "os1": 0.0}
FLAT, ROUGH = 0.03, 0.12
"""Shares of the smallest of a neighbourhood's three spreads: below it lies on a plane, above it fills space."""


@dataclass(frozen=True)
class View:
    """One scan as its sensor saw it. points: (N, 3) metres in the sensor frame; height: (N,) metres above the road."""

    name: str
    kind: str
    points: np.ndarray
    height: np.ndarray


def real_views(folder: Path) -> Iterator[View]:
    """The first scan of each real site that is no test site."""
    for site in sorted(path for path in folder.glob("*") if path.is_dir() and path.name not in TEST_SITES):
        files = sorted((site / "velodyne").glob("*.bin"))
        if files:
            points = np.fromfile(files[0], dtype="<f4").reshape(-1, 4)[:, :3].astype(float)
            kind = "os1" if "os1" in site.name else "hdl64" if "kitti" in site.name else "hdl32"
            yield View(site.name, kind, points, _above_road(points))


def simulated_view(scans: Scans, name: str, kind: str) -> View:
    """The first scan of a simulated site."""
    first = scans.select(scans.scan == 0)
    points = first.points - first.origins.mean(axis=0) + [0, 0, BEAM_START_M[kind]]
    return View(name, kind, points, _above_road(points))


def _above_road(points: np.ndarray) -> np.ndarray:
    """(N,) heights over the plane through the lowest returns within 12 m."""
    near = np.hypot(points[:, 0], points[:, 1]) < 12
    road = near & (points[:, 2] < np.quantile(points[near, 2], 0.3) + 0.1)
    for margin in (0.3, 0.15, 0.1):
        plane, *_ = np.linalg.lstsq(np.column_stack([points[road, :2], np.ones(road.sum())]), points[road, 2], rcond=None)
        height = points[:, 2] - points[:, :2] @ plane[:2] - plane[2]
        road = near & (np.abs(height) < margin)
    return height


def _above_ground(view: View) -> np.ndarray:
    """(N,) heights over the lowest return of the 3 x 3 cells of 1 m around."""
    cell = np.floor(view.points[:, :2]).astype(int)
    cell -= cell.min(axis=0) - 1
    lowest = np.full(cell.max(axis=0) + 2, np.inf)
    np.minimum.at(lowest, tuple(cell.T), np.where(view.height > -3, view.height, np.inf))
    around = np.min([np.roll(lowest, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)
    return view.height - around[tuple(cell.T)]


def measure(view: View, seed: int = 0) -> dict[str, float]:
    """The numbers of one scan; see the head of this file."""
    rng = np.random.default_rng(seed)
    ranges = np.linalg.norm(view.points, axis=1)
    flat_range = np.hypot(view.points[:, 0], view.points[:, 1])
    over = _above_ground(view)
    ground = over < 0.25
    row = {"returns": len(ranges)}
    row.update({f"range_q{q}": np.quantile(ranges, q / 100) for q in (10, 25, 50, 75, 90)})
    row["ground"] = ground.mean()
    row.update({f"h_q{q}": np.quantile(view.height, q / 100) for q in (50, 75, 90, 97)})
    row["low_2m"] = (over[~ground] < 2).mean()
    bearing = np.floor((np.arctan2(view.points[:, 1], view.points[:, 0]) / np.pi + 1) * 360).astype(int) % 720
    upright = (view.height > 0.5) & (view.height < 2.5)
    for reach in (10, 20):
        row[f"blocked_{reach}"] = len(np.unique(bearing[upright & (flat_range < reach)])) / 720
    near = flat_range < 25
    voxels = np.unique(np.floor(view.points[near] / 0.2).astype(int), axis=0)
    row["voxels"] = len(voxels) / 1000
    tree = cKDTree(voxels)
    middles = voxels[rng.integers(len(voxels), size=200)]
    row["box_occ"] = np.mean(tree.query_ball_point(middles, 16, p=np.inf, return_length=True)) / 33**3
    smallest = _smallest_spread(rng, view.points[near & (over > 0.5)])
    row["rough"], row["flat"] = (smallest > ROUGH).mean(), (smallest < FLAT).mean()
    row["jumps"] = _jumps(view)
    return {name: float(value) for name, value in row.items()}


def _smallest_spread(rng, points: np.ndarray, samples: int = 2000) -> np.ndarray:
    """Shares of the smallest eigenvalue of the spreads of the returns within 0.4 m around random returns."""
    if len(points) < 50:
        return np.zeros(1)
    tree = cKDTree(points)
    shares = []
    for around in tree.query_ball_point(points[rng.integers(len(points), size=samples)], 0.4):
        if len(around) >= 8:
            values = np.linalg.eigvalsh(np.cov(points[around].T))
            shares.append(values[0] / values.sum())
    return np.array(shares or [0.0])


def _jumps(view: View) -> float:
    """Share of range-image neighbours along a row that lie more than 0.5 m apart."""
    image = range_image(view)
    pairs = np.isfinite(image[:, 1:]) & np.isfinite(image[:, :-1])
    return (np.abs(np.diff(image, axis=1))[pairs] > 0.5).mean()


def range_image(view: View) -> np.ndarray:
    """(rows, columns) metres, NaN without a return; rows of about one ring, the highest first."""
    low, high, rows, columns = {"hdl64": (-25, 5, 64, 1800), "hdl32": (-31, 11.4, 32, 1024), "os1": (-23, 23, 64, 1024)}[view.kind]
    rays = view.points - [0, 0, BEAM_START_M[view.kind]]
    ranges = np.linalg.norm(rays, axis=1)
    elevation = np.rad2deg(np.arcsin(rays[:, 2] / ranges))
    row = np.floor((high - elevation) / (high - low) * rows).astype(int)
    column = np.floor((0.5 - np.arctan2(rays[:, 1], rays[:, 0]) / (2 * np.pi)) * columns).astype(int) % columns
    inside = (row >= 0) & (row < rows)
    image = np.full((rows, columns), np.inf)
    np.minimum.at(image, (row[inside], column[inside]), ranges[inside])
    image[np.isinf(image)] = np.nan
    return image


def drawn(views: list[View], columns: int = 2) -> Figure:
    """Each scan from above and from the side, coloured by height, and its range image."""
    rows = -(-len(views) // columns)
    figure = plt.figure(figsize=(12 * columns, 6.6 * rows))
    grid = figure.add_gridspec(rows, columns, hspace=0.12, wspace=0.08)
    for k, view in enumerate(views):
        parts = grid[k // columns, k % columns].subgridspec(3, 2, height_ratios=[4, 1, 1.2], hspace=0.12, wspace=0.05)
        order = np.argsort(view.height)
        x, y = view.points[order, 0], view.points[order, 1]
        height = view.height[order]
        for offset, reach in ((0, 45), (1, 15)):
            axis = figure.add_subplot(parts[0, offset])
            axis.scatter(x, y, c=height, cmap="turbo", vmin=-0.3, vmax=4, s=0.25 if reach > 20 else 0.8, linewidths=0)
            axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[], facecolor="black")
            axis.set_title(f"{view.name}, {len(x):,} returns" if offset == 0 else f"nearest {reach} m", fontsize=9)
        axis = figure.add_subplot(parts[1, :])
        slab = np.abs(y) < 14
        axis.scatter(x[slab], height[slab], c=y[slab], cmap="twilight", s=0.3, linewidths=0)
        axis.set(xlim=(-45, 45), ylim=(-1, 9), aspect="equal", facecolor="black", xticks=[], yticks=[0, 4, 8])
        axis.set_ylabel("m", labelpad=1)
        axis = figure.add_subplot(parts[2, :])
        axis.imshow(np.log(range_image(view)), aspect="auto", cmap="turbo", vmin=np.log(3), vmax=np.log(70), interpolation="nearest")
        axis.set(xticks=[], yticks=[])
    return figure


def draw(path: Path, views: list[View]) -> None:
    """`drawn` as a PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = drawn(views)
    figure.savefig(path, dpi=70, bbox_inches="tight")
    plt.close(figure)


def print_table(rows: dict[str, dict[str, float]]) -> None:
    columns = list(next(iter(rows.values())))
    print(f"{'':30s}" + "".join(f"{column:>11s}" for column in columns))
    for name, row in rows.items():
        print(f"{name[:30]:30s}" + "".join(f"{row[column]:11.3f}" if row[column] < 1e4 else f"{row[column]:11.0f}" for column in columns))


def summarised(rows: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Mean, smallest and largest of each column."""
    columns = list(next(iter(rows.values())))
    table = {column: np.array([row[column] for row in rows.values()]) for column in columns}
    return {name: {c: float(getattr(table[c], name)()) for c in columns} for name in ("mean", "min", "max")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--streets", type=int, default=14)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--pictures", type=Path, default=Path("outputs/simulated_streets"))
    parser.add_argument("--no-real", action="store_true", help="leave the real sites out")
    arguments = parser.parse_args()

    real = [] if arguments.no_real else list(real_views(data_folder() / "3d"))
    simulated, seconds = [], []
    for k, seed in enumerate(range(arguments.first_seed, arguments.first_seed + arguments.streets)):
        kind = SENSOR_TURNS[k % len(SENSOR_TURNS)]
        start = time.process_time()
        scans = simulate_street(StreetSettings(sensor=kind, single_scan_share=1.0), seed)
        seconds.append(time.process_time() - start)
        simulated.append(simulated_view(scans, f"simulated {seed}", kind))
    summary = {}
    for title, views in (("real", real), ("simulated", simulated)):
        for kind in BEAM_START_M:
            rows = {view.name: measure(view) for view in views if view.kind == kind}
            if rows:
                print(f"\n{title}, {kind}")
                summary[f"{title}, {kind}"] = summarised(rows)
                print_table({**rows, **summary[f"{title}, {kind}"]})
    print(f"{np.mean(seconds):.2f} s of one core a single scan")
    for title, views in (("real", real), ("simulated", simulated)):
        for part in range(0, len(views), 4):
            draw(arguments.pictures / f"{title}_{part // 4}.png", views[part : part + 4])
    numbers = arguments.pictures / "numbers.json"
    numbers.write_text(json.dumps({"seconds_per_scan": float(np.mean(seconds)), "summary": summary}, indent=1) + "\n")
    print(f"pictures and numbers: {arguments.pictures}")


if __name__ == "__main__":
    main()
