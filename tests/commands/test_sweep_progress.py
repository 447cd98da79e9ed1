"""How a multirun says what its jobs left: in folders of several sweeps, by this launch or an earlier one."""

import json
import os

import pytest
from warm_start import train

from hilbertvae.checks import InputError
from hilbertvae.commands.sweep_progress import Job, say_how_it_ended, stamps
from hilbertvae.reports.run_folder import write_refusal
from toy_sweeps import put, put_failed

pytest.importorskip("embreex")
pytestmark = pytest.mark.filterwarnings("ignore")


def test_jobs_that_differ_in_the_name_of_their_sweep_are_found_where_they_lie(tmp_path):
    """A result of the same job's name in another sweep's folder is not theirs."""
    words = ["-m", "+sweep=fig2", "debug=fast", "study.cloud=uniform", "name=s-${grid.start}"]
    done = train(tmp_path, *words, "start=quick_means,random")
    assert done.returncode == 0 and "FAILED" not in done.stdout, done.stderr
    assert "2 of 2 jobs have results in outputs/debug/s-quick_means, outputs/debug/s-random" in done.stdout
    for start in ("quick_means", "random"):
        listed = json.loads((tmp_path / f"outputs/debug/s-{start}/sweep.json").read_text())
        assert listed == {"sweep": "fig2", "size": "quick", "jobs": [f"{start}-seed0"]}


def test_jobs_of_one_name_in_folders_of_two_sweeps_overwrite_nothing(tmp_path):
    words = ["-m", "debug=fast", "mapper=[nearest]", "pictures=false", "evaluation.occlusion=false"]
    done = train(tmp_path, *words, "name=a,b", "trainer.threads=1")
    assert done.returncode == 0 and "2 of 2 jobs have results in outputs/debug/a, outputs/debug/b" in done.stdout, done.stderr


def test_what_lay_there_before_is_not_counted(tmp_path, capsys):
    jobs = [Job(tmp_path, "quick", f"{name}-seed0", scored=True) for name in ("old", "broke", "refused", "new", "again", "fails", "none")]
    for job in jobs[:3]:
        put(tmp_path, job.name, {"nearest": [0.5, 0.6]})
    put_failed(tmp_path, "broke-seed0")
    again = put(tmp_path, "again-seed0", {"nearest": [0.5, 0.6]})
    (tmp_path / "none-seed0").mkdir()
    (tmp_path / "none-seed0/model.safetensors").touch()
    before = stamps(jobs)
    write_refusal(tmp_path / "refused-seed0", InputError("no such gap"))
    put(tmp_path, "new-seed0", {"nearest": [0.5, 0.6]})
    put_failed(tmp_path, "fails-seed0", "MemoryError: too large")
    os.utime(again)
    say_how_it_ended(jobs, before)
    assert capsys.readouterr().out.strip().splitlines() == [
        f"2 of 7 jobs have results in {tmp_path}",
        "not done old-seed0: what lies there is of an earlier launch",
        "not done broke-seed0: what lies there is of an earlier launch",
        "FAILED refused-seed0: no such gap (what lies there is of an earlier run)",
        "FAILED fails-seed0: run: MemoryError: too large",
        "not done none-seed0",
    ]


def test_a_job_that_is_of_two_sweeps_is_named_with_its_folder(tmp_path, capsys):
    jobs = [Job(tmp_path / sweep, "quick", "default-seed0", scored=True) for sweep in "ab"]
    put(tmp_path / "a", "default-seed0", {"nearest": [0.5, 0.6]})
    say_how_it_ended(jobs, {})
    said = capsys.readouterr().out
    assert f"1 of 2 jobs have results in {tmp_path / 'a'}, {tmp_path / 'b'}" in said and f"not done {jobs[1].folder}\n" in said
