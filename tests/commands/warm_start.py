"""`python -m hilbertvae.train` without the half of its time that imports take: a process that has imported what it needs, and done nothing
else, forks for each command. What a command imports, and when, is asked of processes that start by themselves (`test_public_face.py`)."""

import json
import os
import runpy
import subprocess
import sys
from importlib import import_module
from pathlib import Path

NEEDED = ("hilbertvae.commands.train", "hilbertvae.reports.report", "hilbertvae.training.scoring", "hilbertvae.training.train")
_started: list[subprocess.Popen] = []


def train(folder: Path, *words: str) -> subprocess.CompletedProcess:
    """The exit code of the command in `folder`, and what it printed."""
    if not _started:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, __file__]
        _started.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment))
    said = [folder / "stdout.txt", folder / "stderr.txt"]
    try:
        print(json.dumps([*map(str, said), *words]), file=_started[0].stdin, flush=True)
        code = int(_started[0].stdout.readline())
    except BaseException:  # a test that took too long: its command's answer would be the next one's
        _started.pop().kill()
        raise
    done = subprocess.CompletedProcess(words, code, *(path.read_text(encoding="utf-8") for path in said))
    for path in said:
        path.unlink()
    return done


def fork_for_each_command() -> None:
    """Reads commands from stdin, and writes their exit codes; it ends with whoever asks."""
    for name in NEEDED:
        import_module(name)
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        if child := os.fork():
            print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), file=answers, flush=True)
            continue
        out, error, *sys.argv[1:] = json.loads(line)
        for number, path in enumerate((os.devnull, out, error)):
            os.dup2(os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
        os.chdir(Path(out).parent)
        runpy.run_module("hilbertvae.train", run_name="__main__", alter_sys=True)
        return


if __name__ == "__main__":
    fork_for_each_command()
