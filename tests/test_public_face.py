"""What `import hilbertvae` offers."""

import ast
import contextlib
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import hilbertvae
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scoring import protocol
from toy_rooms import tiny_reconstructor


def test_every_name_is_there():
    for name in hilbertvae.__all__:
        assert getattr(hilbertvae, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        _ = hilbertvae.colour


def test_type_checkers_and_editors_are_told_the_same_names():
    """They don't follow names that are imported late; without, all were of type Any, and any name was there."""
    tree = ast.parse(Path(hilbertvae.__file__).read_text(encoding="utf-8"))
    told = {name.name: node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for name in node.names}
    del told["TYPE_CHECKING"], told["import_module"]
    assert told == hilbertvae._WHERE


def test_names_are_listed_before_they_are_used():
    """As by completion in a shell: they are imported late."""
    program = "import hilbertvae; print(sorted(set(hilbertvae.__all__) - set(dir(hilbertvae))))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_importing_costs_neither_torch_nor_lightning():
    program = "import sys, hilbertvae; print([name for name in ('torch', 'lightning', 'sklearn') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_the_estimators_need_neither_lightning_nor_hydra():
    program = (
        "import sys; from hilbertvae import load_mapper, evaluate, cloud_from_scans, open_site;"
        "print([name for name in ('lightning', 'hydra', 'omegaconf') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_a_saved_map_answers_without_torch(room, tmp_path):
    """To import that takes longer than a thousand answers, and more memory than most maps."""
    cloud = room.fit
    mapper = HilbertMap(tiny_reconstructor(), weights="unit").fit(cloud.points, cloud.occupied, cloud.weight)
    path = hilbertvae.save_map(mapper, tmp_path / "room.map")
    program = f"import sys, hilbertvae; hilbertvae.load_map({str(path)!r}).predict_map([[0.0, 0.0]]); print('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip() == "False"


@pytest.mark.parametrize("command", ["map", "query"])
def test_help_and_typing_errors_do_not_wait_for_torch(command):
    program = f"""
import sys
from hilbertvae.commands.{command} import main
assert main(["--help"]) == 0 and main(["colour=red"]) == 2
print([name for name in ("torch", "sklearn", "matplotlib") if name in sys.modules])
"""
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.endswith("\n[]\n")


@pytest.mark.parametrize(("words", "code"), [(["--help"], 0), (["sweep", "--sweep=colour"], 2)])
def test_help_and_typing_errors_of_tables_wait_for_nothing_that_makes_them(words, code):
    program = f"""
import sys
from hilbertvae.commands.table import main
try:
    main({words})
except SystemExit as ended:
    assert ended.code == {code}
print([name for name in ("torch", "sklearn", "scipy", "matplotlib") if name in sys.modules])
"""
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.endswith("[]\n")


@pytest.mark.parametrize("words", [["--help"], ["--cfg", "job"], ["seed=-1"], ["colour=red"]], ids=" ".join)
def test_a_training_that_is_not_begun_waits_for_neither_torch_nor_scikit_learn(words, tmp_path):
    """Also each time that a shell completes a word of it."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "hilbertvae.train", *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == (0 if words[0].startswith("--") else 2 if words == ["seed=-1"] else 1), done.stderr
    assert "| hilbertvae.training.settings" in re.sub(" +", " ", done.stderr) and not re.search(r"\| +(torch|sklearn)$", done.stderr, re.M)


@pytest.mark.parametrize(("word", "completed"), [("experiment=real_2", "experiment=real_2d"), ("trainer.ep", "trainer.epochs=")])
def test_a_shell_completes_keys_and_choices(word, completed):
    line = f".venv/bin/hilbertvae-train {word}"
    asked = {**os.environ, "COMP_LINE": line, "COMP_POINT": str(len(line))}
    words = [sys.executable, "-m", "hilbertvae.train", "-sc", "query=bash"]
    assert completed in subprocess.run(words, capture_output=True, text=True, check=True, env=asked).stdout.split()


@pytest.mark.parametrize("command", ["map", "query", "table", "train"])
def test_each_command_says_which_version_it_is(command, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"hilbertvae-{command}", "--version"])
    with contextlib.suppress(SystemExit):
        importlib.import_module(f"hilbertvae.commands.{command}").main()
    assert capsys.readouterr().out == f"hilbertvae {hilbertvae.__version__}\n"


@pytest.mark.parametrize("resolution_m", [-1.0, float("nan"), "fine"])
def test_a_site_of_voxels_without_a_size_is_refused(resolution_m):
    with pytest.raises(hilbertvae.InputError, match="resolution_m"):
        hilbertvae.open_site("simulated:7", resolution_m)


def test_a_mapper_is_scored_by_the_protocol_of_the_method_unless_told_otherwise(room, monkeypatch):
    told = []
    monkeypatch.setattr(protocol, "evaluate_alike", lambda mappers, site, protocol, progress: told.append(protocol))
    hilbertvae.evaluate(NearestMapper(), room)
    assert told == [hilbertvae.Protocol(gap_seeds=[0, 1, 2, 3, 4], gap_ratio=0.5, cluster_size_m=5.0)] and told[0].occlusion


def test_make_lists_what_can_be_made():
    made = Path(__file__).parents[1] / "Makefile"
    own = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}  # the suite itself is run by make
    said = subprocess.run(["make", "-f", str(made), "help"], capture_output=True, text=True, check=True, env=own).stdout
    assert [line.split()[0] for line in said.splitlines()] == ["help", "install", "run", "run-3d", "test", "fuzz", "clean"]
