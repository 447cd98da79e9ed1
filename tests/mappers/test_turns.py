"""Threads that share a map that grows."""

import copy
import os
import pickle
import sys
import threading

import numpy as np
import pytest
from growing_toys import add, answers, clouds, network, queries_of, streamed

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from hilbertvae.mappers.turns import turn_of


@pytest.fixture
def switching():
    """Threads change as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.parametrize("reconstruct", [True, False])
def test_who_asks_and_who_adds_take_turns(place, reconstruct, switching, tmp_path):
    """Whatever is asked meanwhile, the map is the one that scans alone would make, and nobody is told that it is damaged."""
    parts, queries = clouds(place)[:6], queries_of(place)
    alone = streamed(HilbertMap(network(place.dimension)), parts)
    shared, failed, ended = HilbertMap(network(place.dimension)), [], threading.Event()
    for part in parts[:2]:
        add(shared, part, reconstruct=reconstruct)
    asks = ("predict_proba", "predict_map", "predict_std", "describe", "known", "observed", "features")

    def ask(name):
        while not ended.is_set():
            try:
                getattr(shared, name)(queries[:50]) if name else save_map(shared, tmp_path / "shared.map")
            except Exception as error:
                failed.append(error)

    threads = [threading.Thread(target=ask, args=(name,)) for name in (*asks, None)]
    for thread in threads:
        thread.start()
    try:
        for part in parts[2:]:
            add(shared, part, reconstruct=reconstruct)
    finally:
        ended.set()
        for thread in threads:
            thread.join()
    assert not failed
    for ours, theirs in zip(answers(shared, queries), answers(alone, queries), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    answers(load_map(tmp_path / "shared.map"), queries)


def test_each_map_has_turns_of_its_own_and_copies_have_others(room):
    mapper = HilbertMap(network(2))
    streamed(mapper, clouds(room, every=4))
    with turn_of(mapper):
        for other in (copy.deepcopy(mapper), pickle.loads(pickle.dumps(mapper))):
            thread = threading.Thread(target=lambda other=other: other.predict_proba(room.fit.points[:5]))
            thread.start()
            thread.join(20)
            assert not thread.is_alive()
    assert turn_of(mapper) is turn_of(mapper) is not turn_of(copy.copy(mapper))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_a_forked_process_may_ask_whoever_had_the_turn(room):
    mapper = HilbertMap(weights="unit", grid=network(2).grid)
    streamed(mapper, clouds(room, every=4))
    holds, ended = threading.Event(), threading.Event()

    def hold():
        with turn_of(mapper):
            holds.set()
            ended.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    holds.wait()
    child = os.fork()
    if not child:
        mapper.observed(room.fit.points[:5])
        os._exit(7)
    ended.set()
    thread.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
