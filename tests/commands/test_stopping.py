"""SIGTERM, which `timeout`, SLURM and containers send to the first process alone, ends a run with all of its processes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("embreex")

TRAIN = [sys.executable, "-m", "hilbertvae.train"]
ENDLESS = ["debug=fast", "trainer.threads=1", "trainer.epochs=100000"]
"""Nothing of it is ever finished."""


def members(session: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            state = Path(f"/proc/{name}/stat").read_text().rsplit(")", 1)[1].split()[0]
            if os.getsid(int(name)) == session and state != "Z":
                found.append(int(name))
        except OSError:  # it has ended meanwhile
            continue
    return found


def stop_while_training(folder: Path, *words: str) -> tuple[int, str]:
    """The exit code and what was printed; none of the command's processes may be left a minute later."""
    with open(folder / "log", "w") as log:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        started = subprocess.Popen([*TRAIN, *words, *ENDLESS], cwd=folder, stdout=log, stderr=log, env=environment, start_new_session=True)
        try:
            until = time.monotonic() + 240
            while not list(folder.glob("outputs/**/last.ckpt")):
                assert started.poll() is None and time.monotonic() < until, (folder / "log").read_text()
                time.sleep(0.1)
            started.terminate()
            code = started.wait(60)
            until = time.monotonic() + 60
            while members(started.pid):
                assert time.monotonic() < until, f"processes {members(started.pid)} went on"
                time.sleep(0.1)
        finally:
            for process in members(started.pid):
                os.kill(process, signal.SIGKILL)
    return code, (folder / "log").read_text()


def test_a_training_stops_and_says_how_it_goes_on(tmp_path):
    code, said = stop_while_training(tmp_path)
    assert code == 130, said
    assert "the same command goes on from the last epoch in" in said


def test_a_reader_that_is_gone_fails_no_run(tmp_path):
    """`hilbertvae-train ... | head` ends when `head` has had enough; what an earlier run had scored stays."""
    command = [*TRAIN, "debug=fast", "trainer.threads=1", "mapper=[nearest,octomap]", "pictures=false", "output=run"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
    subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=240, check=True)
    before = (tmp_path / "run/result.json").read_bytes()
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, cwd=tmp_path, env=environment, stdout=write, stderr=subprocess.PIPE, text=True, timeout=240)
    os.close(write)
    assert done.returncode == 1 and "Traceback" not in done.stderr and "nobody reads its output any more" in done.stderr
    assert (tmp_path / "run/result.json").read_bytes() == before


def test_a_multirun_stops_and_says_what_was_not_done(tmp_path):
    code, said = stop_while_training(tmp_path, "-m", "+sweep=ablation", "cases/ablation=default,unmasked")
    assert code == 130, said
    assert "the same command goes on from" in said and "Traceback" not in said and "FAILED" not in said
    assert "0 of 2 jobs have results" in said and "not done default-seed0\n" in said and "not done unmasked-seed0\n" in said


def test_the_workers_of_a_sweep_stop_with_it(tmp_path):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    code, _ = stop_while_training(tmp_path, "-m", "+sweep=ablation", "launcher=joblib", "cases/ablation=default,unmasked")
    assert code != 0
