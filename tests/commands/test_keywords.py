import re
import subprocess
import sys

import numpy as np
import pytest
from map_command_toys import npz_of

from hilbertvae.checks import InputError
from hilbertvae.commands import map as map_command
from hilbertvae.commands import query as query_command
from hilbertvae.commands.keywords import from_home, settings_of
from hilbertvae.mapping import MapSettings
from toy_rooms import tiny_reconstructor


@pytest.mark.parametrize(("word", "first"), [("map=its", b"0\n"), ("--help", b"say key=value ...\n")])
def test_a_reader_that_has_had_enough_is_no_error(word, first):
    """As `hilbertvae-query ... | head -1`: more lines than a pipe holds."""
    code = f"""
import sys
from hilbertvae.commands.keywords import run_command
from hilbertvae.commands.query import QuerySettings

def say(settings):
    print(*range(100_000), sep=chr(10), flush=True)

sys.exit(run_command("say", QuerySettings, "Much. " * 100_000, say, ["{word}"]))
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == first
        process.stdout.close()
        assert process.stderr.read() == b"" and process.wait() == 1


def test_the_user_s_folder_in_paths(tmp_path, monkeypatch):
    """Alone those that begin with it, and not those of no user."""
    monkeypatch.setenv("HOME", str(tmp_path))
    settings = MapSettings(scans="~/a ~/b", output=None, weights="2d")
    assert from_home(settings, "scans", "output", "weights") == MapSettings(scans=f"{tmp_path}/a ~/b", output=None, weights="2d")
    for path in ("", "./~/a", "a/~", "~nobody-of-this-name/a"):
        assert from_home(MapSettings(scans=path), "scans").scans == path


def test_commands_know_the_user_s_folder(room, tmp_path, monkeypatch):
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(work)
    npz_of(room, home / "room.npz")
    tiny_reconstructor(2).save(home / "tiny.safetensors")
    np.savetxt(home / "asked.csv", np.zeros((3, 2)), delimiter=",")
    words = ["scans=~/room.npz", "output=~/maps", "weights=~/tiny.safetensors", "fill=off", "exports=[npz]"]
    assert map_command.main(words) == 0 and (home / "maps" / "map.npz").exists()
    assert query_command.main(["map=~/maps", "points=~/asked.csv", "output=~/said.csv"]) == 0
    assert len((home / "said.csv").read_text().splitlines()) == 4
    assert not list(work.iterdir())


@pytest.mark.parametrize("typed", ["ros,points", "ros, points", "[ros,points]", "[ros, points]"])
def test_a_list_of_words_needs_no_brackets(typed):
    assert settings_of(MapSettings, [f"exports={typed}"]).exports == ["ros", "points"]
    assert settings_of(MapSettings, ["exports=ros"]).exports == ["ros"] and settings_of(MapSettings, ["exports=null"]).exports is None
    assert settings_of(MapSettings, ["exports=ros,"]).exports == ["ros"]


@pytest.mark.parametrize("typed", ["0,-1,0.5", "0, -1, 0.5", "[0,-1,0.5]"])
def test_a_list_of_numbers_needs_no_brackets_either(typed):
    assert settings_of(MapSettings, [f"sensor_origin_m={typed}"]).sensor_origin_m == [0.0, -1.0, 0.5]
    for wrong in ("0,a", "[0,1"):
        with pytest.raises(InputError, match=re.escape(f"sensor_origin_m: expected [number,number,...], got '{wrong}'")):
            settings_of(MapSettings, [f"sensor_origin_m={wrong}"])
