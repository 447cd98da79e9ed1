"""Fixtures of the tests of simulated sites."""

import sys

import pytest


@pytest.fixture
def sim():
    """Skips without the extra that simulation needs."""
    pytest.importorskip("embreex")
    pytest.importorskip("shapely")


@pytest.fixture
def no_shapely(monkeypatch):
    """As where that extra is not installed."""
    for name in [name for name in sys.modules if name.split(".")[0] == "shapely"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "shapely", None)
