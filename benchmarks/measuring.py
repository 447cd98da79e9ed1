"""What every benchmark shares: its arguments, stopwatches, the printed table, and the JSON beside it."""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib import metadata
from pathlib import Path
from unittest.mock import patch

from hilbertvae.files import write_json
from hilbertvae.reports.provenance import cpu_name, git_state, package_versions, without_folders
from hilbertvae.simulate.building import BuildingSettings

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "docs" / "results" / "benchmarks"
QUICK_RESULTS = ROOT / "outputs" / "benchmarks"
"""Of `--quick`, whose numbers mean nothing: beside those that are committed they would replace them."""
OCTOMAP_CORES = "one: its binding is built without OpenMP"
SMALL_BUILDING = BuildingSettings(shortest_extent_m=12.0, longest_extent_m=15.0, scans=50)
"""For tests."""
RIVALS = ("faiss-cpu", "octomap-python", "hydra-joblib-launcher", "submitit", "ray")


def arguments(description: str) -> argparse.ArgumentParser:
    """A parser with what all benchmarks take."""
    parser = argparse.ArgumentParser(description=description.strip().splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes, for tests: the numbers mean nothing")
    parser.add_argument("--output", type=Path, help="folder of the JSON file (default: docs/results/benchmarks; quick: outputs/benchmarks)")
    return parser


def seconds_of(work: Callable[[], object], repeats: int = 1) -> tuple[float, object]:
    """The shortest wall time of some repeats, and what the last one returned."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return best, result


@contextmanager
def stage_seconds(stages: dict[str, tuple[object, str]]) -> Iterator[dict[str, float]]:
    """Wall time by stage while the block runs; a stage is all calls of one function: `{name: (where it is looked up, its name there)}`.

    So what is timed is what users run. Of stages within each other the outer one has the inner one's time too.
    """
    seconds = dict.fromkeys(stages, 0.0)

    def timed(stage: str, function: Callable) -> Callable:
        def call(*given, **named):
            start = time.perf_counter()
            try:
                return function(*given, **named)
            finally:
                seconds[stage] += time.perf_counter() - start

        return call

    with ExitStack() as patches:
        for stage, (owner, name) in stages.items():
            patches.enter_context(patch.object(owner, name, timed(stage, getattr(owner, name))))
        yield seconds


def target(what: str, wanted: str, found: float, met: bool) -> dict:
    """A promise, and whether it was kept."""
    return {"what": what, "wanted": wanted, "found": float(found), "met": bool(met)}


def report(name: str, given: argparse.Namespace, rows: list[dict], targets: list[dict], facts: dict, script: str | None = None) -> Path:
    """Print the rows and the targets, and write `<name>.json` with the machine, the versions, the commit and the command.

    script: of what name the benchmark is, if it writes several files.
    """
    columns = list(dict.fromkeys(column for row in rows for column in row))
    cells = [columns, *([_cell(row.get(column)) for column in columns] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    for first, *others in cells:
        print("  ".join([first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]))
    for row in targets:
        print(f"{'met   ' if row['met'] else 'MISSED'} {row['what']}: {row['found']:.4g} (wanted {row['wanted']})")
    path = (given.output or (QUICK_RESULTS if given.quick else RESULTS)) / f"{name}.json"
    content = {
        "benchmark": name,
        "quick": given.quick,
        "rows": rows,
        "targets": targets,
        "facts": facts,
        "machine": {
            "cpu": cpu_name(),
            "cpus": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "load_at_the_end": [round(load, 2) for load in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        },
        "versions": {"python": platform.python_version(), **package_versions(), **_rivals()},
        "git": git_state(Path(__file__).parent),
        "command": ["python", f"benchmarks/{script or name}.py", *without_folders(sys.argv[1:])],
    }
    write_json(path, content)
    print(f"written: {path.name}")
    return path


def _cell(value: object) -> str:
    return "" if value is None else f"{value:,.4g}" if isinstance(value, float) else f"{value}"


def _rivals() -> dict[str, str]:
    installed = {}
    for name in RIVALS:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return installed
