"""Do simulated buildings look like real ones? A table of numbers and a picture of both side by side.

    python benchmarks/simulated_against_real.py [--buildings 24] [--first-seed 1000] [--picture PNG]

Compared are the training sites and the validation site only, never a test site. Real sites that are not in the data
folder (`HILBERTVAE_DATA`, default ../shared/data) are left out. Numbers are of maps with voxels of 0.1 m:

- known_m2: area seen; occupied: share of occupied among known voxels; grazed: share of the occupied that most beams
  passed through.
- thick: voxels through an occupied voxel in the thinnest of four directions, mean and 90 % quantile.
- unknown, box_occ: shares of unknown and of occupied voxels in boxes of 6.4 m around random occupied voxels;
  unknown_sd: spread of the former from box to box.
- clutter, specks: share of occupied voxels in connected parts of fewer than 12 and fewer than 3 voxels.
- near: mean over occupied voxels of the share of known ones among the 24 around. range_m: median range of returns.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import matplotlib
import numpy as np
from scipy import ndimage

from hilbertvae.checks import InputError
from hilbertvae.cloud import voxel_cloud
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.sites import CATALOGUE, read_site
from hilbertvae.simulate.building import BuildingSettings, simulate_building
from hilbertvae.voxel_votes import voxel_votes

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

RESOLUTION_M = 0.1
BOX = 64


def measure(scans: Scans, seed: int = 0) -> dict[str, float]:
    """The numbers of one site; see the head of this file."""
    rng = np.random.default_rng(seed)
    cloud, votes = voxel_cloud(scans, RESOLUTION_M), voxel_votes(scans, RESOLUTION_M)
    cell = np.floor(cloud.points / RESOLUTION_M).astype(int)
    cell += BOX - cell.min(axis=0)
    grid = np.zeros(cell.max(axis=0) + BOX + 1, dtype=np.int8)  # -1 free, 0 unknown, 1 occupied
    grid[tuple(cell.T)] = np.where(cloud.occupied, 1, -1)
    occupied = grid > 0
    at = np.argwhere(occupied)
    labels, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    size = np.bincount(labels.ravel())[labels[occupied]]
    thick = np.min([_run_lengths(occupied, *step) for step in ((0, 1), (1, 0), (1, 1), (1, -1))], axis=0)
    boxes = [grid[i - BOX // 2 : i + BOX // 2, j - BOX // 2 : j + BOX // 2] for i, j in at[rng.integers(len(at), size=400)]]
    unknown = np.array([(box == 0).mean() for box in boxes])
    around = ndimage.uniform_filter((grid != 0).astype(float), 5)[occupied]
    hit_share = (votes.hits / (votes.hits + votes.frees))[cloud.occupied]
    return {
        "known_m2": len(cloud) * RESOLUTION_M**2,
        "occupied": cloud.occupied.mean(),
        "grazed": (hit_share < 0.5).mean(),
        "thick": thick.mean(),
        "thick_90": np.quantile(thick, 0.9),
        "unknown": unknown.mean(),
        "unknown_sd": unknown.std(),
        "box_occ": np.mean([(box > 0).mean() for box in boxes]),
        "clutter": (size < 12).mean(),
        "specks": (size < 3).mean(),
        "near": around.mean(),
        "range_m": np.median(np.linalg.norm(scans.points - scans.origins, axis=1)),
    }


def _run_lengths(occupied: np.ndarray, dx: int, dy: int) -> np.ndarray:
    """(K,) for each occupied voxel the length of its run of occupied voxels along (dx, dy), up to 12."""
    at = np.argwhere(occupied)
    length = np.ones(len(at), dtype=int)
    for sign in (1, -1):
        going = np.ones(len(at), dtype=bool)
        for step in range(1, 12):
            i, j = (at + sign * step * np.array([dx, dy])).T
            going &= occupied[i, j]
            length += going
    return np.minimum(length, 12)


def print_table(rows: dict[str, dict[str, float]]) -> None:
    columns = list(next(iter(rows.values())))
    print(f"{'':24s}" + "".join(f"{column:>11s}" for column in columns))
    for name, row in rows.items():
        print(f"{name:24s}" + "".join(f"{row[column]:11.3f}" for column in columns))


def draw(path: Path, sites: dict[str, Scans]) -> None:
    """All sites at one scale on the left of each pair, and 13 m of each close up on the right."""
    columns = 4
    rows = -(-len(sites) // columns)
    figure, axes = plt.subplots(rows, 2 * columns, figsize=(6.5 * columns, 3.4 * rows), squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    rng = np.random.default_rng(1)
    for k, (name, scans) in enumerate(sites.items()):
        whole, close = axes[k // columns, 2 * (k % columns) : 2 * (k % columns) + 2]
        cloud = voxel_cloud(scans, RESOLUTION_M)
        cell = np.floor(cloud.points / RESOLUTION_M).astype(int)
        low = cell.min(axis=0)
        image = np.full(cell.max(axis=0) - low + 1, 0.75)
        image[tuple((cell - low).T)] = np.where(cloud.occupied, 0.0, 1.0)
        whole.imshow(image.T, cmap="gray", origin="lower", vmin=0, vmax=1)
        whole.set_title(f"{name}, {image.shape[0] / 10:.0f} x {image.shape[1] / 10:.0f} m", fontsize=9)
        occupied = cell[cloud.occupied] - low
        i, j = occupied[rng.integers(len(occupied))]
        padded = np.pad(image, BOX, constant_values=0.75)[i : i + 2 * BOX, j : j + 2 * BOX]
        close.imshow(padded.T, cmap="gray", origin="lower", vmin=0, vmax=1)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=75)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--buildings", type=int, default=24)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--picture", type=Path, default=Path("outputs/simulated_against_real.png"))
    arguments = parser.parse_args()

    real, simulated = {}, {}
    for name in (name for name, entry in CATALOGUE.items() if entry.dimension == 2 and entry.role in ("train", "validate")):
        try:
            real[name] = read_site(name)
        except InputError as error:
            print(f"left out: {error}")
    start = time.perf_counter()
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.buildings):
        simulated[f"simulated {seed}"] = simulate_building(BuildingSettings(), seed)
    seconds = (time.perf_counter() - start) / arguments.buildings

    rows = {name: measure(scans) for name, scans in real.items()}
    drawn = {name: measure(scans) for name, scans in simulated.items()}
    summary = {}
    for title, group in (("real", rows), ("simulated", drawn)):
        if group:
            table = {column: np.array([row[column] for row in group.values()]) for column in next(iter(group.values()))}
            summary[f"{title}, mean of {len(group)}"] = {column: float(values.mean()) for column, values in table.items()}
            summary[f"{title}, smallest"] = {column: float(values.min()) for column, values in table.items()}
            summary[f"{title}, largest"] = {column: float(values.max()) for column, values in table.items()}
    print_table({**rows, **drawn, **summary})
    print(f"{seconds:.2f} s a building")
    draw(arguments.picture, {**real, **dict(list(simulated.items())[: 24 - len(real)])})
    numbers = arguments.picture.with_suffix(".json")
    numbers.write_text(json.dumps({"seconds_per_building": seconds, "summary": summary}, indent=1) + "\n")
    print(f"picture: {arguments.picture}, numbers: {numbers}")


if __name__ == "__main__":
    main()
