"""The task `clustering`: one way to start a clustering, timed and compared (the paper's Fig. 2), as `clustering.json`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from rich.progress import Progress

import hilbertvae
from hilbertvae.clusters.comparison import study, study_clouds
from hilbertvae.files import hash_of, json_object, write_json
from hilbertvae.reports.provenance import provenance
from hilbertvae.reports.run_folder import RUN, finite
from hilbertvae.scans.sites import site_hashes
from hilbertvae.tables.clustering import NAME, SCHEMA_VERSION
from hilbertvae.training.settings import Settings


def run_clustering(settings: Settings, again: bool = True) -> int:
    """Try `grid.start` as `study` says, on returns of the first test site where it asks for them; the exit code."""
    path = Path(settings.output) / NAME
    source = settings.source()
    site = settings.data.test[0] if settings.study.cloud == "returns" else None
    if site:
        source.check(site)
    tested = source.made_of(site) if site else None
    identity = {"version": hilbertvae.__version__, "start": settings.grid.start, "study": asdict(settings.study), "site": tested}
    if not again and _is_finished(path, hash_of(identity)):
        print(f"{settings.output}: finished before")
        return 0
    clouds = study_clouds(settings.study, source.scans(site).points if site else None)  # first: one that is refused leaves what was there
    hashes = site_hashes([site]) if site else {}
    about = provenance(asdict(settings), identity=identity, data=hashes, seeds={"clouds": settings.study.seeds})
    path.unlink(missing_ok=True)  # a study that is stopped half-way leaves nothing of an earlier one
    with Progress() as progress:
        bar = progress.add_task(f"{settings.grid.start}", total=None)
        rows = study(settings.grid.start, settings.study, clouds, lambda done, of: progress.update(bar, completed=done, total=of))
    write_json(path, {"schema_version": SCHEMA_VERSION, "status": "ok", "failed": {}, "rows": rows, **about})
    print(f"Results: {path}")
    return 0


def write_clustering_failure(folder: str | Path, config: dict, error: BaseException) -> None:
    """`clustering.json` with status `failed`, for a study that broke."""
    why = {RUN: f"{type(error).__name__}: {error}"}
    about = provenance(finite(config))  # the value that was refused may be one that JSON has no word for
    write_json(Path(folder) / NAME, {"schema_version": SCHEMA_VERSION, "status": "failed", "failed": why, "rows": [], **about})


def has_study(folder: str | Path) -> bool:
    """Whether a study has left its rows in `folder`, whatever its settings were."""
    return bool(json_object(Path(folder) / NAME).get("rows"))


def _is_finished(path: Path, config_hash: str) -> bool:
    found = json_object(path)
    return found.get("status") == "ok" and found.get("config_hash") == config_hash
