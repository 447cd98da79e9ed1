"""Threads that share a map that grows."""

import copy
import os
import pickle
import sys
import threading
import time

import numpy as np
import pytest
from growing_toys import add, answers, clouds, network, queries_of, streamed

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from hilbertvae.mappers.turns import turn_of

ASKS = ("predict_proba", "predict_map", "predict_std", "describe", "known", "observed", "features")


@pytest.fixture
def switching():
    """Threads change as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.parametrize("loaded", [True, False])
@pytest.mark.parametrize("reconstruct", [True, False])
def test_who_asks_and_who_adds_take_turns(place, reconstruct, loaded, switching, tmp_path):
    """Whatever is asked meanwhile, the map is the one that scans alone would make, and nobody is told that it is damaged."""
    parts, queries = clouds(place)[:6], queries_of(place)
    alone = streamed(HilbertMap(network(place.dimension)), parts)
    shared, failed, ended = HilbertMap(network(place.dimension)), [], threading.Event()
    for part in parts[:2]:
        add(shared, part, reconstruct=reconstruct)
    if loaded:
        weights = shared.reconstructor.save(tmp_path / "network.safetensors")
        shared = load_map(save_map(shared, tmp_path / "loaded.map"), checkpoint=weights)
    ways = [lambda name=name: getattr(shared, name)(queries[:50]) for name in ASKS]
    ways += [lambda: save_map(shared, tmp_path / "shared.map"), lambda: copy.deepcopy(shared).predict_map(queries[:50])]

    def ask(way):
        while not ended.is_set():
            try:
                way()
            except Exception as error:
                failed.append(error)

    threads = [threading.Thread(target=ask, args=(way,)) for way in ways]
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


def test_a_map_of_somebody_s_own_may_ask_for_features(room, monkeypatch):
    """In threads that work for the one that has the turn."""

    class Own(HilbertMap):
        def _probability(self, queries):
            return 1 / (1 + np.exp(-self.rank_weights_.logit(*self.features(queries))))

    monkeypatch.setattr("hilbertvae.cores.cores", lambda: 4)
    own, usual = (streamed(made(network(2)), clouds(room, every=4)) for made in (Own, HilbertMap))
    own.chunk, said, queries = 20, [], queries_of(room)
    thread = threading.Thread(target=lambda: said.append(own.predict_proba(queries)), daemon=True)
    thread.start()
    thread.join(30)
    np.testing.assert_allclose(said[0], usual.predict_proba(queries))


def test_maps_that_older_versions_have_pickled_answer_beyond_their_boxes(room):
    mapper = HilbertMap(weights="unit", grid=network(2).grid).fit(room.fit.points, room.fit.occupied, room.fit.weight)
    for name in ("_near", "_looked_at"):
        vars(mapper.evidence_).pop(name, None)
    assert pickle.loads(pickle.dumps(mapper)).predict_proba([[30.0, 30.0]]).shape == (1, 2)


def test_a_map_is_begun_once(room):
    """Also where two threads come with the first scan: neither's is lost."""
    parts = clouds(room, every=4)[:2]
    shared, alone = HilbertMap(network(2)), streamed(HilbertMap(network(2)), parts)
    threads = [threading.Thread(target=add, args=(shared, part)) for part in parts]
    with turn_of(shared):
        for thread in threads:
            thread.start()
            time.sleep(0.1)  # it waits for its turn
    for thread in threads:
        thread.join()
    assert len(shared.evidence_) == len(alone.evidence_) > max(len(streamed(HilbertMap(network(2)), [part]).evidence_) for part in parts)
