import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from hilbertvae.last_few import LastFew


def test_what_was_asked_for_longest_ago_is_let_go():
    last, made = LastFew(2), []

    def ask(key):
        return last.get(key, lambda: made.append(key) or [key])

    assert [ask(key) for key in "abacab"] == [["a"], ["b"], ["a"], ["c"], ["a"], ["b"]]
    assert made == ["a", "b", "c", "b"] and len(last) == 2


def test_nothing_is_kept_of_what_can_t_be_made_and_none_is_a_thing_as_any():
    last, made = LastFew(2), []
    with pytest.raises(ZeroDivisionError):
        last.get("a", lambda: 1 / 0)
    assert len(last) == 0
    assert [last.get("b", lambda: made.append("b")) for _ in range(2)] == [None, None] and made == ["b"]


def test_threads_that_ask_at_once_share_one():
    last, made = LastFew(2), []

    def make():
        time.sleep(0.05)
        made.append("a")
        return ["a"]

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: last.get("a", make), range(4)))
    assert made == ["a"] and all(each is found[0] for each in found)
