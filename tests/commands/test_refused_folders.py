"""A folder that a run can't write to: another run's, or one without room."""

import os
import shutil
import subprocess
import sys

import pytest
from warm_start import train

from hilbertvae.commands.hydra_files import HydraFiles
from hilbertvae.reports.run_lock import alone_in

IS_ROOT = os.name == "posix" and os.geteuid() == 0
WITHOUT_RIGHTS = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all"] if IS_ROOT else []
"""What a command begins with, so that root can't write where nobody may."""


def test_a_folder_in_which_another_run_is_at_work_is_refused_and_left_alone(tmp_path):
    (tmp_path / "run").mkdir()
    with alone_in(tmp_path / "run", waits=False):
        done = train(tmp_path, "debug=fast", "mapper=[nearest]", f"output={tmp_path / 'run'}")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert done.stderr.strip().startswith("hilbertvae-train: output: another run is at work in ")
    assert not (tmp_path / "run/result.json").exists()


def test_a_run_that_is_refused_leaves_no_word_of_it(tmp_path):
    """Neither in a new folder, nor in place of what the run whose results lie there was called with."""

    def files():
        return {str(path.relative_to(tmp_path)): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def code(*words):
        return train(tmp_path, "debug=fast", "mapper=[nearest]", "pictures=false", *words).returncode

    assert code("trainer.epochs=-1", "output=runs/new") == 2 and list(tmp_path.iterdir()) == []
    (tmp_path / "runs").mkdir()
    assert code("trainer.epochs=-1", "output=runs/new") == 2 and list(tmp_path.rglob("*")) == [tmp_path / "runs"]
    assert code("output=runs/done") == 0
    before = files()
    assert any("overrides.yaml" in name for name in before)
    assert code("trainer.epochs=-1", "output=runs/done", "evaluation.gap_seeds=[5]") == 2 and files() == before
    with alone_in(tmp_path / "runs/done", waits=False):
        assert code("output=runs/done", "evaluation.gap_seeds=[5]") == 2 and files() == before


@pytest.mark.skipif(os.name != "posix" or IS_ROOT and not shutil.which("setpriv"), reason="no folder is closed to whoever runs this")
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("seed=0", "{} can't be written"),
        ("-m seed=0,1", "{} can't be written"),
        ("-m +sweep=ablation", "{} can't be written"),
        ("output=file/run", "expected a folder, {}/file is a file"),
        ("output=made", "made can't be written"),
        ("-m hydra.sweep.dir=file seed=0,1", "expected a folder, {}/file is a file"),
    ],
)
def test_a_folder_that_can_t_be_written_is_told_in_one_line(tmp_path, words, named):
    """Hydra makes it before the run has begun."""
    (tmp_path / "file").write_text("")
    (tmp_path / "made").mkdir(mode=0o555)
    tmp_path.chmod(0o555)
    command = [*WITHOUT_RIGHTS, sys.executable, "-m", "hilbertvae.train", *words.split(), "debug=fast"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    tmp_path.chmod(0o755)
    assert done.returncode == 2 and done.stderr == f"hilbertvae-train: output: {named.format(tmp_path)}\n"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "made"]


@pytest.mark.skipif(os.name != "posix", reason="limits of a process")
def test_a_file_that_can_t_be_written_is_named_in_one_line(tmp_path):
    def few_bytes():
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # as a full disk, but for what it is called

    command = [sys.executable, "-m", "hilbertvae.train", "debug=fast", "mapper=[]", f"data.cache={tmp_path / 'cache'}"]
    done = subprocess.run([*command, f"output={tmp_path / 'run'}"], capture_output=True, text=True, check=False, preexec_fn=few_bytes)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"hilbertvae-train: {tmp_path / 'cache'}{os.sep}grids-") and ".npy: " in last
    assert not (tmp_path / "cache").exists()


def test_a_full_disk_is_told_in_one_line_even_where_the_failure_itself_finds_no_room(tmp_path):
    """Lightning makes a checkpoint in the system's temporary folder and moves it: named is where it could not go."""
    program = """
from hilbertvae.commands import train
def full(*_, **__):
    raise OSError(28, "No space left on device", "/elsewhere/tmp1", None, "checkpoints/best.ckpt")
train.run = train.write_failure = full
train.main()
"""
    command = [sys.executable, "-c", program, "debug=fast", f"output={tmp_path / 'run'}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.strip() == "hilbertvae-train: checkpoints/best.ckpt: No space left on device"


def test_a_single_run_that_breaks_leaves_the_result_of_one_before_it(tmp_path):
    """Of a full disk, or of anything else: why stands beside it."""
    command = ["debug=fast", "mapper=[nearest]", "pictures=false", "trainer.threads=1", f"output={tmp_path / 'run'}"]
    assert train(tmp_path, *command).returncode == 0
    before = (tmp_path / "run/result.json").read_bytes()
    for error in ("OSError(28, 'No space left on device', 'checkpoints/best.ckpt')", "RuntimeError('out of memory')"):
        program = f"""
from hilbertvae.commands import train
def broken(*_, **__):
    raise {error}
train.run = broken
train.main()
"""
        done = subprocess.run([sys.executable, "-c", program, *command], capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert (tmp_path / "run/result.json").read_bytes() == before
        assert (tmp_path / "run/refused.txt").read_text().startswith(error.split("(")[0] + ": ")


def test_a_run_of_fewer_sites_leaves_none_of_another(tmp_path):
    """Tables, and whoever looks into the folder, would take it for one of the run's own."""
    pytest.importorskip("shapely")
    command = ["debug=fast", "mapper=[nearest]", "evaluation.occlusion=false", "trainer.threads=1", f"output={tmp_path / 'run'}"]
    second = tmp_path / "run/simulated-900003"
    for sites, left in (("900002,simulated:900003", ["pictures", "result.json", "scores.md"]), ("900002", [])):
        assert train(tmp_path, *command, f"data.test=[simulated:{sites}]").returncode == 0
        assert sorted(path.name for path in second.iterdir()) == left
    assert (tmp_path / "run/result.json").exists() and (tmp_path / "run/pictures").exists()


def test_a_run_that_is_refused_takes_nothing_of_the_one_that_is_at_work(tmp_path):
    """Though both have begun before there was a folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(HydraFiles, "begun", tmp_path / "run")
        patch.setattr(HydraFiles, "found", {})
        patch.setattr(HydraFiles, "made", [tmp_path / "run"])
        (tmp_path / "run").mkdir()
        for name in (".lock", "training.json"):
            (tmp_path / "run" / name).touch()
        HydraFiles.take_back()
        assert len(list((tmp_path / "run").iterdir())) == 2
        HydraFiles.take_back_training()  # of the one that has the lock
        assert not list((tmp_path / "run").iterdir())


def test_a_training_that_is_refused_late_leaves_no_folder(tmp_path):
    """When its grids are there, and its network is to be made."""
    pytest.importorskip("embreex")
    words = ["debug=fast", "mapper=[]", f"data.cache={tmp_path / 'cache'}", "trainer.initial=2d", "output=runs/new"]
    done = train(tmp_path, *words)
    assert done.returncode == 2 and "trainer.initial: " in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("many", [False, True])
def test_a_mapper_that_fails_ends_a_single_run_without_a_traceback(tmp_path, many):
    program = """
from hilbertvae.commands import train
train.run = lambda *_, **__: 1
train.main()
"""
    words = ["-m", "seed=0", f"hydra.sweep.dir={tmp_path}"] if many else [f"output={tmp_path / 'run'}"]
    done = subprocess.run([sys.executable, "-c", program, *words, "debug=fast"], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and ("Traceback" in done.stderr) == many
    assert "a mapper, or its pictures, failed; see the lines above and result.json" in done.stderr


def test_a_job_of_a_multirun_says_which_file_could_not_be_written(tmp_path):
    """And not the temporary one, in a folder that may have room."""
    program = """
from hilbertvae.commands import train
def full(*_, **__):
    raise OSError(28, "No space left on device", "/tmp/tmp1", None, "checkpoints/best.ckpt")
train.run = full
train.main()
"""
    command = [sys.executable, "-c", program, "-m", "debug=fast", "seed=0", f"hydra.sweep.dir={tmp_path}"]
    assert subprocess.run(command, capture_output=True, text=True, check=False).returncode == 1
    (result,) = tmp_path.rglob("result.json")
    assert "No space left on device: 'checkpoints/best.ckpt'" in result.read_text() and "tmp1" not in result.read_text()
