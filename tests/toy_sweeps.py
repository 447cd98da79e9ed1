"""Sweeps' folders with results that are written by hand, so that every mean is known beforehand."""

import csv
import io
import json
from pathlib import Path

from hilbertvae.reports.result_json import write_result
from hilbertvae.scoring.metrics import METRICS
from hilbertvae.scoring.result import Result

READINGS = ("points", "voxels")
REGIONS = ("observed", "fitted", "gaps")
CEILING = {"points": {"precision": 0.97, "recall": 0.96}}
SECONDS = {"fit": [1.0, 3.0], "query_per_million": [0.5, 0.5]}


def scores_of(values, **others):
    """Every metric the same in all readings and regions: `values`, one per gap seed, of 100 samples, half of them occupied. others: values
    of a metric in gaps alone."""
    every = {metric: list(values) for metric in METRICS} | {"count": [100.0] * len(values), "base_rate": [0.5] * len(values)}
    found = {reading: {region: {metric: list(each) for metric, each in every.items()} for region in REGIONS} for reading in READINGS}
    for reading in READINGS:
        found[reading]["gaps"] |= {metric: list(given) for metric, given in others.items()}
    return found


def put(folder, job, mappers, case=None, seed=None, config=None, about=None, site="hall", dimension=2, protocol=None, **parts):
    """Write FOLDER/job/result.json. mappers: by name, values per gap seed, or what `scores_of` gives. parts: fields of the `Result`."""
    name = job.split("/")[0]
    scores = {mapper: values if isinstance(values, dict) else scores_of(values) for mapper, values in mappers.items()}
    protocol = {"gap_seeds": [0, 1], "gap_ratio": 0.5, "cluster_size_m": 5.0, "centred": False, "occlusion": True} | (protocol or {})
    result = Result(
        site, dimension, protocol["gap_ratio"] * protocol["cluster_size_m"], protocol["gap_seeds"], CEILING,
        **{"scores": scores, "seconds": dict.fromkeys(mappers, SECONDS), "protocol": protocol} | parts,
    )  # fmt: skip
    settings = {
        "case": case or name.rsplit("-seed", 1)[0],
        "seed": int(name.rsplit("-seed", 1)[1]) if seed is None else seed,
        "resolution_m": 0.1,
        "grid": {"cells": 32, "cluster_diameter_m": 5.0, "inner_radius_m": 1.4},
        "network": {"kind": "gated", "channels": [8, 16], "latent": 4, "variational": True},
        "mapper": {},
    }
    made = {
        "config": merged(settings, config or {}),
        "git": {"commit": "a" * 40, "dirty": False},
        "packages": {"hilbertvae": "0.1.0", "numpy": "2.0"},
        "host": {"cpu": "an abacus", "threads": 1, "numbers": "float32"},
        "data": {"hall": "00ff"},
        "stage_seconds": {"train": 90.0, "grids": 20.0},
    } | (about or {})
    return write_result(Path(folder) / job / "result.json", result, made)


def change(path, how):
    """Edit a JSON file in place."""
    content = json.loads(path.read_text())
    how(content)
    path.write_text(json.dumps(content))


def put_failed(folder, job, message="ValueError: no"):
    """A job that broke before anything was scored."""
    return put(folder, job, {}, site="", failed={"run": message}, gaps=[], protocol={"gap_seeds": []})


def merged(settings, config):
    """`settings` with dotted keys of `config` replaced."""
    for key, value in config.items():
        node = settings
        *parts, last = key.split(".")
        for part in parts:
            node = node.setdefault(part, {})
        node[last] = value
    return settings


def declare(folder, sweep, jobs, size="quick"):
    """Write sweep.json."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    (Path(folder) / "sweep.json").write_text(json.dumps({"sweep": sweep, "size": size, "jobs": list(jobs)}))


def rows_of_csv(text):
    """Rows of a CSV file as dictionaries of text."""
    return list(csv.DictReader(io.StringIO(text)))


def lines_with(markdown, *words):
    """Rows of a Markdown table, as lists of cells, whose first cell is one of the words."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.splitlines() if line.startswith("|")]
    return [row for row in cells if row[0] in words]
