import os
import threading

import pytest

from hilbertvae import cores as module
from hilbertvae.cores import FEW, cores, on_all_cores, shared_by, workers


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process is bound to cores on Linux alone")
def test_only_the_cores_that_a_process_may_use_count():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert cores() == len(allowed)


def test_processes_side_by_side_take_their_part_of_the_cores(monkeypatch):
    alone = cores()
    with pytest.raises(ZeroDivisionError), shared_by(2 * alone):
        assert cores() == 1  # and not none
        with shared_by(1):
            assert cores() == alone
        raise ZeroDivisionError
    assert cores() == alone
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(16), raising=False)
    with shared_by(5):
        assert cores() == 4  # and one more, since the others wait at times
        other = threading.Thread(target=lambda: others.append(cores()))
        others = []
        other.start(), other.join()
    assert others == [16]  # of another thread, which may have other work


def test_one_thread_for_what_others_are_beside_and_all_for_more(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 7)
    assert [workers(count) for count in (0, FEW, FEW + 1)] == [1, 1, 7]


def test_as_many_tasks_at_a_time_as_there_are_cores(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 3)
    together, done = threading.Barrier(3, timeout=30), []  # breaks unless three are there at once
    on_all_cores(lambda item: (together.wait(), done.append(item)), range(6))
    assert sorted(done) == list(range(6))
    on_all_cores(done.append, [])


def test_what_a_task_raises_is_raised(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 2)
    with pytest.raises(ZeroDivisionError):
        on_all_cores(lambda item: 1 / item, [1, 0, 1])
