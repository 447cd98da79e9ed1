from types import SimpleNamespace

import pytest
from rich.console import Console

from hilbertvae.progress import track


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr("hilbertvae.progress.time", SimpleNamespace(monotonic=lambda: clock.now))
    return clock


def slowly(count, clock, seconds):
    for number in range(count):
        clock.now += seconds
        yield number


def test_a_log_gets_a_line_now_and_then(clock, capsys, monkeypatch):
    monkeypatch.setattr("hilbertvae.progress.get_console", lambda: Console(force_terminal=False))
    assert list(track(slowly(10, clock, 12.0), "Clustering sites", total=10)) == list(range(10))
    said = capsys.readouterr()
    assert said.out == "" and said.err.splitlines() == [
        "Clustering sites: 2 of 10, 36 s", "Clustering sites: 5 of 10, 72 s", "Clustering sites: 8 of 10, 108 s",
    ]  # fmt: skip


def test_short_work_says_nothing_in_a_log(clock, capsys, monkeypatch):
    monkeypatch.setattr("hilbertvae.progress.get_console", lambda: Console(force_terminal=False))
    assert list(track(range(5), "Quick")) == list(range(5)) and list(track([], "None")) == []
    assert capsys.readouterr() == ("", "")


def test_a_terminal_gets_a_bar(monkeypatch, capsys):
    console = Console(force_terminal=True, width=80)
    monkeypatch.setattr("hilbertvae.progress.get_console", lambda: console)
    monkeypatch.setattr("rich.progress.get_console", lambda: console)
    assert list(track(iter("abc"), "Letters", total=3)) == list("abc")
    assert "Letters" in capsys.readouterr().out
