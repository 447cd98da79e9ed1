import pytest
import torch

from hilbertvae.commands.gpus import give_gpus


@pytest.fixture
def machine(monkeypatch):
    """A machine with four GPUs, of which nothing is used yet."""
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    monkeypatch.setattr(torch.cuda, "is_initialized", lambda: False)
    for name in ("CUDA_VISIBLE_DEVICES", "HILBERTVAE_GPUS_GIVEN"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    return monkeypatch


def given(machine, job, wanted):
    import os

    machine.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    machine.delenv("HILBERTVAE_GPUS_GIVEN", raising=False)
    give_gpus(job, wanted)
    return os.environ.get("CUDA_VISIBLE_DEVICES")


def test_jobs_at_a_time_get_gpus_of_their_own(machine):
    assert [given(machine, job, 1) for job in range(6)] == ["0", "1", "2", "3", "0", "1"]
    assert [given(machine, job, 2) for job in range(3)] == ["0,1", "2,3", "0,1"]


def test_one_that_wants_all_is_given_all(machine):
    assert given(machine, 3, 4) is None


def test_only_what_was_visible_is_dealt_out(machine):
    import os

    machine.setenv("CUDA_VISIBLE_DEVICES", "5,7")
    give_gpus(3, 1)
    assert os.environ["CUDA_VISIBLE_DEVICES"] == "7"
    give_gpus(2, 1)  # a process that is used again keeps what it has
    assert os.environ["CUDA_VISIBLE_DEVICES"] == "7"


def test_without_gpus_nothing_is_set(machine):
    machine.setattr(torch.cuda, "device_count", lambda: 0)
    assert given(machine, 1, 1) is None
