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


def test_code_that_was_edited_since_is_what_was_loaded(tmp_path, monkeypatch):
    """What is kept would else be marked by code that did not compute it, and be taken by the run that loads that code."""
    path = tmp_path / "edited.py"
    path.write_text("class Mine:\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    kind = importlib.import_module("edited").Mine
    before = foreign_source(kind)
    path.write_text("class Mine:\n    better = True\n")
    assert foreign_source(kind) == before
    assert "better" in foreign_source(importlib.reload(sys.modules["edited"]).Mine)
    assert foreign_source(kind) is None  # another one of that name now


def test_a_class_that_a_script_holds_and_one_that_was_sent_elsewhere(monkeypatch):
    class Here:
        pass

    assert foreign_source(Here) is None  # a function's own
    assert foreign_source(test_a_class_that_a_script_holds_and_one_that_was_sent_elsewhere) == inspect.getsource(sys.modules[__name__])
