"""Training grids in cache files: built once, on several processes, and named after the hash of what made them."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

import hilbertvae
from hilbertvae.files import atomic, hash_of
from hilbertvae.grids.training_grids import ClusteringSettings, training_grids
from hilbertvae.progress import track
from hilbertvae.reconstruction.blocks import is_detailed
from hilbertvae.training.settings import Settings

VALIDATION_SEEDS = (1_000_001, 1_000_002)
GRID_SOURCES = (
    "voxel_votes.py",
    "cloud.py",
    "gaps.py",
    "occlusions.py",
    "site.py",
    "bucket_index.py",
    "scans",
    "simulate",
    "clusters",
    "grids",
    "training/kept_grids.py",
)
"""What grids come from."""


def build_all(jobs: list[tuple[str, int]], settings: Settings) -> list[Path]:
    """The cache file of each (site, clustering seed); those that are not there are built, with progress."""
    paths = [Path(settings.data.cache) / f"grids-{grids_hash(name, seed, settings)}.npy" for name, seed in jobs]
    missing = {path: job for path, job in zip(paths, jobs, strict=True) if not path.exists()}
    work = (delayed(_build)(path, *job, settings) for path, job in missing.items())
    if missing:
        results = Parallel(n_jobs=settings.data.processes or -1, return_as="generator_unordered")(work)
        for _ in track(results, "Clustering sites", total=len(missing)):
            pass
    return paths


def is_voted(settings: Settings) -> bool:
    """Whether targets say how many votes each cell has."""
    return settings.likelihood.vote_power > 0


def load_pairs(paths: list[Path], voted: bool) -> tuple[np.ndarray, np.ndarray]:
    """(shown, target) of all files, one after the other: filled in place, since they can take half of the memory that there is."""
    files = [np.load(path, mmap_mode="r") for path in paths]
    count, (channels, *cells), own = sum(len(file) for file in files), files[0].shape[1:], 1 + voted
    shown, target = np.empty((count, channels - own, *cells), np.int8), np.empty((count, own, *cells), np.int8)
    start = 0
    for file in files:
        end = start + len(file)
        shown[start:end], target[start:end] = file[:, :-own], file[:, -own:]
        start = end
    return tuple(grids[:, 0] if grids.shape[1] == 1 else grids for grids in (shown, target))


def grids_hash(name: str, seed: int, settings: Settings) -> str:
    """What names a cache file: all that its grids depend on."""
    made_of = {
        "version": hilbertvae.__version__,
        "code": code_hash(GRID_SOURCES),
        **settings.source().made_of(name),
        "seed": seed,
        "resolution_m": settings.resolution_m,
        "grid": asdict(replace(settings.grid, interpolated=False)),  # which tells how a map reads grids
        "detailed": is_detailed(settings.network),
        "voted": is_voted(settings),
        "clustering": asdict(_clustering(seed, settings)),
    }
    return hash_of(made_of)


@cache
def code_hash(parts: tuple[str, ...]) -> str:
    """The hash of these sources of the package, so that a cache never outlives the code that filled it."""
    folder = Path(hilbertvae.__file__).parent
    files = sorted(file for part in parts for file in ([folder / part] if part.endswith(".py") else (folder / part).glob("*.py")))
    return hash_of([file.read_text(encoding="utf-8") for file in files])


def _clustering(seed: int, settings: Settings) -> ClusteringSettings:
    """The validation site is seen as it will be mapped: unturned, with gaps of one size, whatever training shows."""
    if seed in VALIDATION_SEEDS:
        return ClusteringSettings(1, [settings.validation_gap_m] * 2, turn=False)
    return replace(settings.clustering, clusterings=1, turn=settings.clustering.turn and seed > 0)


def draw_seed(name: str, seed: int, settings: Settings) -> int:
    """What a clustering's randomness comes from: the site, too, else all simulated sites would be turned by one angle."""
    return seed if seed in VALIDATION_SEEDS else int(hash_of([settings.source().made_of(name), seed])[:8], 16)


def _build(path: Path, name: str, seed: int, settings: Settings) -> None:
    scans = settings.source().scans(name)
    how = _clustering(seed, settings), draw_seed(name, seed, settings), is_detailed(settings.network), is_voted(settings)
    pair = training_grids(scans, settings.resolution_m, settings.grid, *how)
    channels = [grids if grids.ndim == settings.dimension + 2 else grids[:, None] for grids in pair]
    with atomic(path) as temporary:
        np.save(temporary, np.concatenate(channels, axis=1))
