"""Mappers of one's own, wherever their classes lie."""

import sys

import pytest

from hilbertvae.checks import InputError
from hilbertvae.commands.build import build_mappers

OWN = """
import numpy as np
from hilbertvae.mappers.mapper import Mapper


class Half(Mapper):
    def __init__(self, value=0.5):
        self.value = value

    def _fit(self, points, occupied, weight):
        self.fitted_ = True

    def _probability(self, queries):
        return np.full(len(queries), self.value)


class Other:
    called = []

    def __init__(self):
        self.called.append(self)
"""


def test_a_mapper_of_a_package_of_ones_own(tmp_path, monkeypatch):
    (tmp_path / "somebodys_mappers.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    found = build_mappers({"half": {"_target_": "somebodys_mappers.Half", "value": 0.25}})["half"]
    assert found.fit([[0.0, 0.0], [1.0, 0.0]], [0, 1]).predict_proba([[0.0, 0.0]])[0, 1] == 0.25
    with pytest.raises(InputError, match="mapper.other._target_: expected the path of a Mapper's class, .*got 'somebodys_mappers.Other'"):
        build_mappers({"other": {"_target_": "somebodys_mappers.Other"}})
    assert not sys.modules["somebodys_mappers"].Other.called  # it was not even made


@pytest.mark.parametrize("target", ["nowhere.Mapper", "os.system", "os.path", "hilbertvae.mappers.nearest.Nearest", 3, None, ""])
def test_what_is_no_mapper_is_refused_by_its_key(target):
    with pytest.raises(InputError, match="^mapper.mine._target_: "):
        build_mappers({"mine": {"_target_": target}})
