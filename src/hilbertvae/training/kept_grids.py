"""Training grids in cache files: built once, on several processes, and named after the hash of what made them."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

import hilbertvae
from hilbertvae.checks import named
from hilbertvae.cores import shared_by
from hilbertvae.files import atomic, hash_of
from hilbertvae.grids.training_grids import ClusteringSettings, training_grids
from hilbertvae.progress import track
from hilbertvae.reconstruction.blocks import is_detailed
from hilbertvae.training.code_hash import code_hash
from hilbertvae.training.settings import Settings

VALIDATION_SEEDS = (1_000_001, 1_000_002)
GRID_SOURCES = (
    "sums.py",
    "portions.py",
    "voxel_votes.py",
    "cloud.py",
    "gaps.py",
    "occlusions.py",
    "observed_map.py",
    "site.py",
    "bucket_index.py",
    "scans",
    "simulate",
    "clusters/ask_means.py",
    "clusters/clusters.py",
    "clusters/kmeans_parallel.py",
    "clusters/kmeans_plus_plus.py",
    "clusters/quick_means.py",
    "clusters/random_start.py",
    "clusters/starts.py",
    "grids",
    "training/kept_grids.py",
)
"""What grids come from."""


def build_all(jobs: list[tuple[str, int]], settings: Settings) -> list[Path]:
    """The cache file of each (site, clustering seed); those that are not there are built, with progress."""
    contents = {name: settings.source().made_of(name) for name in dict(jobs)}
    paths = [Path(settings.data.cache) / f"grids-{grids_hash(contents[name], seed, settings)}.npy" for name, seed in jobs]
    missing = {path: job for path, job in zip(paths, jobs, strict=True) if not path.exists()}
    processes = min(effective_n_jobs(settings.data.processes or -1), len(missing))
    work = (delayed(_build)(path, name, contents[name], seed, settings, processes) for path, (name, seed) in missing.items())
    if missing:
        results = Parallel(n_jobs=processes, return_as="generator_unordered")(work)
        for _ in track(results, "Clustering sites", total=len(missing)):
            pass
    return paths


def is_voted(settings: Settings) -> bool:
    """Whether targets say how many votes each cell has."""
    return settings.likelihood.vote_power > 0 and settings.likelihood.kind != "gaussian"  # which counts no cell for more than another


def grids_hash(contents: dict, seed: int, settings: Settings) -> str:
    """What names a cache file: all that its grids depend on. contents: what a site is made of (`SiteSource.made_of`)."""
    made_of = {
        "version": hilbertvae.__version__,
        "code": code_hash(GRID_SOURCES),
        **contents,
        "seed": seed,
        "resolution_m": settings.resolution_m,
        "grid": asdict(replace(settings.grid, interpolated=False)),  # which tells how a map reads grids
        "detailed": is_detailed(settings.network),
        "voted": is_voted(settings),
        "clustering": asdict(_clustering(seed, settings)),
    }
    return hash_of(made_of)


def _clustering(seed: int, settings: Settings) -> ClusteringSettings:
    """The validation site is seen as it will be mapped: unturned, with gaps of one size, whatever training shows; but as a map where
    training shows nothing but maps."""
    if seed in VALIDATION_SEEDS:
        mapped = float(settings.clustering.mapped_share == 1)
        return ClusteringSettings(1, [settings.validation_gap_m] * 2, mapped_share=mapped, turn=False)
    return replace(settings.clustering, clusterings=1, turn=settings.clustering.turn and seed > 0)


def draw_seed(contents: dict, seed: int) -> int:
    """What a clustering's randomness comes from: the site, too, else all simulated sites would be turned by one angle."""
    return seed if seed in VALIDATION_SEEDS else int(hash_of([contents, seed])[:8], 16)


def _build(path: Path, name: str, contents: dict, seed: int, settings: Settings, processes: int) -> None:
    how = _clustering(seed, settings), draw_seed(contents, seed), is_detailed(settings.network), is_voted(settings)
    with shared_by(processes):
        scans = settings.source().scans(name)
        with named(f"{name}, clustering {seed}"):
            pair = training_grids(scans, settings.resolution_m, settings.grid, *how)
    channels = [grids if grids.ndim == settings.dimension + 2 else grids[:, None] for grids in pair]
    with atomic(path) as temporary:
        np.save(temporary, np.concatenate(channels, axis=1))
