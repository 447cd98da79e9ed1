"""One run at a time in a folder."""

import subprocess
import sys
import threading
import time

import pytest

from hilbertvae.checks import InputError
from hilbertvae.reports.run_lock import alone_in


def test_a_second_run_is_refused_until_the_first_has_ended(tmp_path):
    with alone_in(tmp_path, waits=False):
        with pytest.raises(InputError, match=f"^output: another run is at work in {tmp_path}"), alone_in(tmp_path, waits=False):
            raise AssertionError("not alone")
        with alone_in(tmp_path.parent, waits=False):  # which is another run's folder
            pass
    with alone_in(tmp_path, waits=False):
        pass


def test_a_failed_run_leaves_its_folder_free(tmp_path):
    with pytest.raises(ZeroDivisionError), alone_in(tmp_path, waits=False):
        raise ZeroDivisionError
    with alone_in(tmp_path, waits=False):
        pass


def test_a_job_waits_for_the_end_of_another(tmp_path, capsys):
    ended = []

    def job():
        with alone_in(tmp_path, waits=True):
            ended.append("second")

    with alone_in(tmp_path, waits=False):
        waiting = threading.Thread(target=job)
        waiting.start()
        time.sleep(0.3)
        assert ended == [] and "another run is at work there, and is waited for" in capsys.readouterr().out
        ended.append("first")
    waiting.join(10)
    assert ended == ["first", "second"]


def test_a_run_that_was_killed_has_its_folder_no_more(tmp_path):
    program = f"""
import time
from hilbertvae.reports.run_lock import alone_in
with alone_in({str(tmp_path)!r}, waits=False):
    print("held", flush=True)
    time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError), alone_in(tmp_path, waits=False):
            pass
        holder.kill()
    with alone_in(tmp_path, waits=False):
        pass


def test_what_killed_runs_had_half_written_goes(tmp_path):
    program = f"""
import os, signal
from hilbertvae.files import atomic
names = ("result.json", "checkpoints/best.ckpt", "checkpoints/last", "others/model.ckpt")
blocks = [atomic({str(tmp_path)!r} + "/" + name) for name in names]
for block in blocks:  # of which none may be let go before the end, when it would clear up
    block.__enter__().write_text("half")
os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", program])
    (tmp_path / "checkpoints/best.ckpt").touch()
    (tmp_path / ".env-of-mine.txt").touch()
    with alone_in(tmp_path, waits=False):
        left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert {".lock", ".env-of-mine.txt", "checkpoints/best.ckpt"} <= left
    (other,) = left - {".lock", ".env-of-mine.txt", "checkpoints/best.ckpt"}
    assert other.startswith("others/.model-")


def test_where_files_can_t_be_locked_runs_go_on(tmp_path, monkeypatch):
    def none(*_, **__):
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr("hilbertvae.reports.run_lock.FileLock.acquire", none)
    with alone_in(tmp_path, waits=False):
        pass
