import os

import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import open_dict

from hilbertvae.checks import InputError
from hilbertvae.commands import gpus
from hilbertvae.commands import train as command
from hilbertvae.commands.gpus import SEEN, give_gpus, remember_gpus, see_remembered_gpus


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """A machine with four GPUs, of which nothing is used yet."""
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    monkeypatch.setattr(torch.cuda, "is_initialized", lambda: False)
    monkeypatch.setattr(gpus.tempfile, "gettempdir", lambda: str(tmp_path))
    for name in ("CUDA_VISIBLE_DEVICES", "HILBERTVAE_GPUS_GIVEN"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    processes: list = []
    monkeypatch.setattr(gpus, "_held", [])
    yield monkeypatch, processes
    for lock in [*gpus._held, *(lock for held in processes for lock in held)]:
        lock.release()


def given(machine, wanted):
    """What a process that just began is given, while those before it run."""
    monkeypatch, processes = machine
    processes.append(gpus._held)
    monkeypatch.setattr(gpus, "_held", [])
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.delenv("HILBERTVAE_GPUS_GIVEN", raising=False)
    give_gpus(wanted)
    return os.environ.get("CUDA_VISIBLE_DEVICES")


def test_processes_get_gpus_of_their_own(machine):
    assert [given(machine, 1) for _ in range(4)] == ["0", "1", "2", "3"]
    assert given(machine, 1) in {"0", "1", "2", "3"}  # more jobs at a time than GPUs share them
    machine[1][2][0].release()  # the second process ends
    assert given(machine, 1) == "1"


def test_several_each(machine):
    assert [given(machine, 2) for _ in range(2)] == ["0,1", "2,3"]
    for held in machine[1]:
        for lock in held:
            lock.release()
    assert given(machine, 2) == "0,1"


def test_one_that_wants_all_is_given_all(machine):
    assert given(machine, 4) is None


def test_only_what_was_visible_is_dealt_out(machine):
    monkeypatch, _ = machine
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5,7")
    assert gpus._take("5")
    monkeypatch.setattr(gpus, "_held", [])
    give_gpus(1)
    assert os.environ["CUDA_VISIBLE_DEVICES"] == "7"
    give_gpus(1)  # a process that is used again keeps what it has
    assert os.environ["CUDA_VISIBLE_DEVICES"] == "7"


def test_without_gpus_nothing_is_set(machine):
    machine[0].setattr(torch.cuda, "device_count", lambda: 0)
    assert given(machine, 1) is None


@pytest.mark.parametrize("wanted", [0, -1])
def test_a_wrong_number_is_left_to_who_checks_it(machine, wanted):
    assert given(machine, wanted) is None


def test_where_it_is_too_late_it_is_said(machine):
    machine[0].setattr(torch.cuda, "is_initialized", lambda: True)
    with pytest.warns(UserWarning, match="a GPU was used before they were dealt out"):
        assert given(machine, 1) is None
    assert given(machine, 4) is None  # there is nothing to deal out


@pytest.mark.parametrize("seen", [None, "2,3"])
def test_jobs_of_submitit_on_this_machine_see_what_the_multirun_sees(tmp_path, monkeypatch, seen):
    """submitit itself shows them no GPU, which would make them train on the CPU without a word."""
    submitit = pytest.importorskip("submitit")
    monkeypatch.setenv(SEEN, "")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", seen or "")
    if seen is None:
        monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    remember_gpus()

    def visible():  # in here, so that it is sent to a process that does not find this file
        shown = os.environ.get("CUDA_VISIBLE_DEVICES")
        see_remembered_gpus()
        return shown, os.environ.get("CUDA_VISIBLE_DEVICES")

    jobs = submitit.AutoExecutor(folder=tmp_path, cluster="local")
    assert jobs.submit(visible).result() == ("", seen)


def test_several_gpus_by_slurm_are_refused(tmp_path, monkeypatch):
    pytest.importorskip("submitit")
    with pytest.raises(InputError, match="trainer.devices: expected 1 with launcher=submitit"):
        application("submitit", tmp_path, monkeypatch, "device=cpu", "trainer.devices=2")


@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_a_job_is_given_its_gpus_before_it_looks_at_one(launcher, tmp_path, monkeypatch):
    pytest.importorskip({"joblib": "hydra_plugins.hydra_joblib_launcher", "submitit_local": "submitit"}[launcher])
    asked = []

    def looks(device):
        asked.append(device)
        raise InputError("device: enough")

    monkeypatch.setattr(command, "give_gpus", asked.append)
    monkeypatch.setattr("hilbertvae.reconstruction.precision.check_device", looks)
    with pytest.raises(InputError, match="enough"):
        application(launcher, tmp_path, monkeypatch, "device=cuda", "trainer.devices=2")
    assert asked == [2, "cuda"]


def application(launcher, tmp_path, monkeypatch, *words):
    """A job of a multirun by this launcher."""
    monkeypatch.setenv(command.JOB, "")
    monkeypatch.setattr(HydraConfig.instance(), "cfg", None)
    with initialize_config_dir(str(command.CONF), version_base="1.3"):
        words = [f"launcher={launcher}", *words]
        whole = compose("config", overrides=[*words, "hydra.mode=MULTIRUN"], return_hydra_config=True)
        with open_dict(whole):
            whole.hydra.runtime.output_dir = str(tmp_path)
        HydraConfig.instance().set_config(whole)
        config = compose("config", overrides=words)
    command._application.__wrapped__(config)
