"""Scans of any name, and of one name in two folders, as `hilbertvae-map` takes them."""

import io
import json
import os

import pytest
from map_command_toys import npz_of

from hilbertvae.commands import map as map_command
from hilbertvae.exports.map_folder import scans_hash
from hilbertvae.exports.page import write_page
from hilbertvae.mapping import MapSettings, make_map


@pytest.mark.parametrize("name", ["a$^$b.npz", os.fsdecode(b"B\xfcro.npz"), "日本.npz"])
def test_names_that_are_no_text_to_draw(room, tmp_path, name, monkeypatch, capsys):
    """What TeX would take for a formula, a name in another encoding, and letters that the font lacks."""
    scans = npz_of(room, tmp_path / "room.npz").rename(tmp_path / name)
    out = make_map(MapSettings(scans=str(scans), output=str(tmp_path / "out"), fill=False, exports=["npz"]))
    assert (out / "map.png").stat().st_size > 1000
    monkeypatch.chdir(tmp_path)
    assert map_command.main([f"scans={scans}", "fill=off", "exports=[npz]"]) == 0  # to a folder of that name
    told = capsys.readouterr()
    assert "map.npz" in told.out and "Glyph" not in told.err


def test_a_name_that_the_terminal_can_t_show(room, tmp_path, monkeypatch):
    scans = npz_of(room, tmp_path / "room.npz").rename(tmp_path / "日本.npz")
    said = io.TextIOWrapper(io.BytesIO(), encoding="latin-1")
    monkeypatch.setattr("sys.stdout", said)
    assert map_command.main([f"scans={scans}", f"output={tmp_path / 'out'}", "fill=off", "exports=[npz]"]) == 0
    said.flush()
    assert said.buffer.getvalue().startswith(b"??.npz: 2D")


@pytest.fixture
def room_of_two_days(room, tmp_path):
    """Scans of one name in two folders."""
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
    return [npz_of(room, tmp_path / day / "room.npz") for day in ("monday", "tuesday")]


def test_other_scans_of_the_same_name(room_of_two_days, tmp_path, monkeypatch, capsys):
    """A folder that is named after its scans is theirs."""
    first, second = room_of_two_days
    monkeypatch.chdir(tmp_path)
    words = ["fill=off", "exports=[npz]", "resolution_m=0.2"]
    assert map_command.main([f"scans={first}", *words]) == 0
    before = (tmp_path / "outputs/maps/room.npz/map.npz").stat().st_mtime_ns
    assert map_command.main([f"scans={second}", *words]) == 2
    assert "scans of that name from another place" in capsys.readouterr().err
    assert (tmp_path / "outputs/maps/room.npz/map.npz").stat().st_mtime_ns == before
    assert map_command.main([f"scans={first.relative_to(tmp_path)}", *words]) == 0
    assert map_command.main([f"scans={second}", "output=outputs/maps/room.npz", *words]) == 0


def test_other_scans_of_the_same_name_that_were_mapped_meanwhile(room_of_two_days, tmp_path, monkeypatch, capsys):
    first, second = room_of_two_days
    monkeypatch.chdir(tmp_path)
    words = ["fill=off", "exports=[npz]", "resolution_m=0.2"]

    def meanwhile(*written):
        monkeypatch.undo()
        monkeypatch.chdir(tmp_path)
        assert map_command.main([f"scans={second}", *words]) == 0
        write_page(*written)

    monkeypatch.setattr("hilbertvae.mapping.write_page", meanwhile)
    assert map_command.main([f"scans={first}", *words]) == 2
    assert "scans of that name from another place" in capsys.readouterr().err
    out = tmp_path / "outputs/maps/room.npz"
    assert json.loads((out / "summary.json").read_text())["scans_hash"] == scans_hash(second)
    assert not list(out.glob(".writing-*"))
