"""What is kept from run to run depends on code that is not of the package, too."""

import importlib
import inspect
import sys

from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.training.foreign_code import foreign_source


def test_the_source_of_a_module_and_of_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "somebodys.py").write_text("class Mine:\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("somebodys")
    assert foreign_source(module.Mine) == "class Mine:\n    pass\n" and foreign_source(NearestMapper) == ""
    typed = type("Mine", (), {"__module__": "somebodys"})
    assert foreign_source(typed) is None  # another one of that name
    assert foreign_source(type("Nowhere", (), {"__module__": "somebodys"})) is None
    monkeypatch.delitem(sys.modules, "somebodys")
    assert foreign_source(module.Mine) is None


def test_a_class_that_a_script_holds_and_one_that_was_sent_elsewhere(monkeypatch):
    class Here:
        pass

    assert foreign_source(Here) is None  # a function's own
    assert foreign_source(test_a_class_that_a_script_holds_and_one_that_was_sent_elsewhere) == inspect.getsource(sys.modules[__name__])
