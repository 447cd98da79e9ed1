"""`hilbertvae-table`: what it writes, what it refuses, and that committed tables are what committed results give."""

import io
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from hilbertvae.commands.configuration import SWEEPS
from hilbertvae.commands.table import main
from hilbertvae.tables.kinds import KINDS
from hilbertvae.tables.layouts import LAYOUTS, read_page
from toy_sweeps import declare, put

RESULTS = Path(__file__).parents[2] / "docs" / "results"
COMMITTED = sorted(path.parent for path in RESULTS.glob("**/sweep.json"))


def test_it_writes_the_table_in_both_forms_and_a_figure_and_prints_it(tmp_path, capsys):
    declare(tmp_path / "sweep", "table1", ["cvae-hm-seed0"])
    put(tmp_path / "sweep", "cvae-hm-seed0", {"cvae-hm-points": [0.5, 0.7]})
    assert main([str(tmp_path / "sweep"), "--output", str(tmp_path / "out")]) == 0
    names = {"table.md", "table.csv", "table-order.csv", "figure.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert capsys.readouterr().out == (tmp_path / "out" / "table.md").read_text()
    picture = matplotlib.image.imread(tmp_path / "out" / "figure.png")
    assert picture.shape[0] > 100 and np.ptp(picture[..., :3]) > 0.5
    assert {path.name for path in (tmp_path / "sweep").iterdir()} == {"sweep.json", "cvae-hm-seed0"}
    assert main([str(tmp_path / "sweep")]) == 0 and (tmp_path / "sweep" / "table.md").exists()


def test_a_terminal_that_lacks_the_table_s_signs(tmp_path, monkeypatch):
    put(tmp_path, "cvae-hm-seed0", {"cvae-hm": [0.5, 0.7]})
    said = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", said)
    assert main([str(tmp_path), "--sweep", "table1"]) == 0
    said.flush()
    assert b"mean?sd" in said.buffer.getvalue().lower() and "±" in (tmp_path / "table.md").read_text(encoding="utf-8")


def test_a_refusal_is_one_line_with_exit_code_2_and_leaves_nothing(tmp_path, capsys):
    put(tmp_path, "cvae-hm-seed0", {"cvae-hm": [0.5, 0.7]})
    put(tmp_path, "cvae-hm-seed1", {"cvae-hm": [0.5, 0.7]}, site="stairs")
    assert main([str(tmp_path), "--sweep", "table1", "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "cvae-hm-seed1/result.json: site: 'stairs', but 'hall' in" in error
    assert not (tmp_path / "out").exists()


def test_a_folder_that_can_t_be_written(tmp_path, capsys):
    put(tmp_path, "cvae-hm-seed0", {"cvae-hm": [0.5, 0.7]})
    (tmp_path / "file").write_text("")
    assert main([str(tmp_path), "--sweep", "table1", "--output", str(tmp_path / "file" / "out")]) == 2
    assert capsys.readouterr().err.startswith("hilbertvae-table: ")


def test_every_layout_can_be_asked_for():
    assert tuple(LAYOUTS) == KINDS


def test_every_sweep_is_committed():
    expected = {f"{path.stem}-quick" for path in (SWEEPS / "sweep").glob("*.yaml")}
    assert len(expected) == 8 and expected <= {folder.name for folder in COMMITTED}


@pytest.mark.parametrize("folder", COMMITTED, ids=lambda folder: folder.name)
def test_committed_tables_are_what_the_committed_results_give(folder):
    page = read_page(folder)
    for name, content in {"table.md": page.markdown(), **page.csv_files()}.items():
        assert (folder / name).read_bytes() == content.encode(), f"{folder / name}: run hilbertvae-table {folder}"
    assert (folder / "figure.png").stat().st_size > 1000
