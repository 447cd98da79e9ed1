"""`hilbertvae-table` writes all of its files or none, and says that it was stopped."""

from hilbertvae.commands import table
from hilbertvae.tables import write
from toy_sweeps import declare, put


def test_a_table_that_is_stopped_leaves_what_was_there(tmp_path, monkeypatch, capsys):
    declare(tmp_path, "table1", ["cvae-hm-seed0"])
    put(tmp_path, "cvae-hm-seed0", {"cvae-hm-points": [0.5, 0.7]})
    assert table.main([str(tmp_path)]) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    (tmp_path / "table.md").write_text("earlier")

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(write, "save_picture", stopped)
    assert table.main([str(tmp_path)]) == 130
    assert "hilbertvae-table: stopped" in capsys.readouterr().err
    assert (tmp_path / "table.md").read_text() == "earlier"
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == before.keys()  # and no temporary file
