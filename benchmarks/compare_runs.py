"""Runs that differ in network, recipe and training seed, side by side: mean and spread over training seeds.

    python benchmarks/compare_runs.py FOLDER

Reads every `result.json` below FOLDER/<network>-seed<seed> and writes FOLDER/comparison.md: per network and mapper, in gaps and on
held-out beams, the mean over gap seeds and then mean and standard deviation over training seeds. Runs of another protocol, commit,
version of a package, data or budget than the others' are refused; networks may differ in all else that their recipe says.
"""

from __future__ import annotations

import argparse
import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.files import atomic
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.score_table import markdown, percent

COLUMNS = (
    ("points", "observed", "f1", "observed, points, F1"),
    ("points", "gaps", "precision", "gaps, points, prec."),
    ("points", "gaps", "recall", "recall"),
    ("points", "gaps", "best_f1", "best F1"),
    ("points", "gaps", "auc", "AUC"),
    ("voxels", "gaps", "best_f1", "gaps, voxels, best F1"),
    ("voxels", "gaps", "auc", "AUC"),
)
NAME = re.compile(r"(?P<network>.+)-seed(?P<seed>\d+)")


def compare(folder: Path) -> str:
    """The table of all runs below a folder, as Markdown."""
    runs, alike = defaultdict(list), {}
    for path in sorted(folder.glob("*/result.json")):
        name = NAME.fullmatch(path.parent.name)
        if not name:
            raise InputError(f"{path}: expected a folder named <network>-seed<seed>")
        result, about = read_result(path)
        if not about.get("git") or about["git"]["dirty"]:
            raise InputError(f"{path}: expected a run of a committed tree")
        facts = {"site": result.site, "protocol": result.protocol, "commit": about["git"]["commit"], "packages": about["packages"]}
        facts |= {"trainer.steps": about["config"]["trainer"]["epochs"] * about["config"]["trainer"]["steps_per_epoch"]}
        facts |= {"trainer.batch_size": about["config"]["trainer"]["batch_size"], "data": about["config"]["data"]}
        for key, value in facts.items():
            if alike.setdefault(key, value) != value:
                raise InputError(f"{path}: its {key} differs from the other runs'")
        for mapper, scores in result.scores.items():
            if "hm" in mapper.split("-"):
                row = [np.mean(scores[reading][region][metric]) for reading, region, metric, _ in COLUMNS]
                runs[name["network"], mapper].append(row)
    if not runs:
        raise InputError(f"{folder}: expected <network>-seed<seed>/result.json, found none")
    header = ["network", "mapper", "runs", *(title for *_, title in COLUMNS)]
    rows = [[network, mapper, str(len(found)), *map(percent, zip(*found, strict=True))] for (network, mapper), found in runs.items()]
    legend = f"In percent: means over gap seeds, then mean±sd over training seeds. Site {alike['site']}, commit {alike['commit'][:12]}."
    return f"{markdown(header, rows)}\n\n{legend}\n"


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(words).folder
    table = compare(folder)
    with atomic(folder / "comparison.md") as temporary:
        temporary.write_text(table, encoding="utf-8")
    print(table)


if __name__ == "__main__":
    main()
