"""One small sweep by every launcher, and by two processes that train together: whether all jobs end well, with which scores, and how long.

    python benchmarks/launchers.py [--quick]

Two jobs on tiny simulated sites (`debug=fast`) that share one training. A launcher that is not installed (extras `slurm`, `ray`) is left
out. All but `trainer=ddp`, which draws other batches, have to give the scores of the plain multirun, to the bit: each runs with one thread.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from measuring import arguments, report, seconds_of, target

from hilbertvae.reports.result_json import read_result

SWEEP = ["-m", "+sweep=ablation", "debug=fast", "cases/ablation=default,weights-unit", "trainer.threads=1", "trainer.accelerator=cpu"]
CHOICES = {
    "multirun": ([], None),
    "joblib": (["launcher=joblib"], "hydra_plugins.hydra_joblib_launcher"),
    "submitit, local": (["launcher=submitit_local"], "hydra_plugins.hydra_submitit_launcher"),
    "ray, local": (["launcher=ray"], "hydra_plugins.hydra_ray_launcher"),
    "ddp, 2 processes": (["trainer=ddp"], None),
}
"""What is said on the command line, and the module that it needs."""


def installed(module: str | None) -> bool:
    try:
        return module is None or find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def run(words: list[str], folder: Path) -> dict:
    """Scores by job, empty for one that left none, and the exit code."""
    command = [sys.executable, "-m", "hilbertvae.train", *SWEEP, *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env={**os.environ, "OMP_NUM_THREADS": "1"})
    paths = sorted((folder / "outputs/debug/ablation-quick").glob("*/result.json"))
    return {"exit code": done.returncode, "scores": {path.parent.name: read_result(path)[0].scores for path in paths}}


def main(words: list[str] | None = None) -> None:
    given = arguments(__doc__).parse_args(words)
    rows, expected = [], None
    for name, (words, module) in CHOICES.items():
        if not installed(module) or (given.quick and name != "multirun"):
            continue
        with tempfile.TemporaryDirectory() as folder:
            seconds, found = seconds_of(lambda words=words, folder=folder: run(words, Path(folder)))
        print(f"{name}: {seconds:.0f} s", file=sys.stderr, flush=True)
        expected = expected or found["scores"]
        jobs = sum(bool(scores) for scores in found["scores"].values())
        same = "" if name.startswith("ddp") else str(found["scores"] == expected)
        rows.append({"what": name, "jobs": jobs, "exit code": found["exit code"], "same scores": same, "seconds": seconds})
    well = sum(row["jobs"] == 2 and row["exit code"] == 0 and row["same scores"] != "False" for row in rows)
    report("launchers", given, rows, [target("ways that ended well", f"{len(rows)}", well, well == len(rows))], {"overrides": SWEEP})


if __name__ == "__main__":
    main()
