import os

import pytest

from hilbertvae import cores as module
from hilbertvae.cores import FEW, cores, workers


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process is bound to cores on Linux alone")
def test_only_the_cores_that_a_process_may_use_count():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert cores() == len(allowed)


def test_one_thread_for_what_others_are_beside_and_all_for_more(monkeypatch):
    monkeypatch.setattr(module, "cores", lambda: 7)
    assert [workers(count) for count in (0, FEW, FEW + 1)] == [1, 1, 7]
