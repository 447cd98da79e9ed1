"""What `hilbertvae-map` refuses, and that it leaves nothing behind."""

import resource
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from map_command_toys import npz_of

from hilbertvae.checks import InputError
from hilbertvae.commands import map as map_command
from hilbertvae.exports.formats import EXPORTS
from hilbertvae.mapping import MapSettings, make_map
from toy_rooms import carmen_line, tiny_reconstructor, write_log


def test_a_key_is_named_as_this_command_has_it(tmp_path, capsys):
    """Elsewhere the settings of reading are a group."""
    np.savez(tmp_path / "cloud.npz", points=np.random.default_rng(0).uniform(1, 5, (100, 3)))
    assert map_command.main([f"scans={tmp_path / 'cloud.npz'}"]) == 2
    said = capsys.readouterr().err
    assert "set sensor_origin_m" in said and "reading." not in said


def test_3d_scans_without_poses_name_the_way_out(box, tmp_path, capsys):
    for number in range(2):
        np.savez(tmp_path / f"{number}.npz", points=box.scans.points[box.scans.scan == number], origins=np.zeros(3))
    assert map_command.main([f"scans={tmp_path}"]) == 2
    assert " poses=kiss_icp" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, said",
    [
        ([], "scans: expected a file or a folder"),
        (["scans=nowhere.log"], "nowhere.log"),
        (["scans=room.npz", "resolution_m=-1"], "resolution_m: expected a positive number"),
        (["scans=room.npz", "resolution_m=wide"], "resolution_m: expected float"),
        (["scans=room.npz", "exports=[ros,png]"], "exports: expected some of"),
        (["scans=room.npz", "exports=[mesh]"], "mesh is for 3D maps, got a 2D one"),
        (["scans=room.npz", "typo=1"], "typo: unknown key; expected one of"),
        (["scans=room.npz", "scans=room.npz"], "scans: given more than once"),
        (["room.npz"], "expected key=value"),
        (["scans=room.npz", "weights=nobody.safetensors"], "nobody.safetensors"),
        (["scans=room.npz", "weights=3d"], "3D"),
        (["scans=room.npz", "max_range_m=0.01"], "room.npz"),
        (["scans=broken.npz"], "broken.npz"),
        (["scans=room.npz", "exports=[ros"], "exports: expected [word,word,...], got '[ros'"),
        (["scans=room.npz", "device=gpu"], "device: expected cpu"),
        (["scans=room.npz", "device=null"], "device: expected cpu, or cuda where there is one, got 'null'"),
        (["scans=null"], "null: no such file or folder"),
        (["scans=drive", "beam_origin=null"], "beam_origin: expected centre, hdl64 or three numbers in metres, got 'null'"),
        (["scans=room.npz", "calibration=null"], "calibration: expected voxels or points, got 'null'"),
        (["scans=room.npz", "every=null"], "every: expected int, got 'null'"),
        (["scans=${HOME}.npz"], "${HOME}.npz"),
        (["scans=???"], "???"),
        (["scans=[/2020]/x"], "[/2020]/x"),
        (["scans=reading.d"], "reading.d"),
        (["scans=house.dwg"], "house.dwg: unknown extension '.dwg'; known are of scans .log .log.gz"),
        (["scans=house.dwg"], "of maps .yaml .yml .pgm .ot .bt, and folders of scans"),
        (["scans=room.npz", "calibration=pixels"], "calibration: expected voxels or points, got 'pixels'"),
        (["scans=room.npz", "every=often"], "every: expected int"),
        (["scans=room.yaml", "max_range_m=3"], "max_range_m: room.yaml is a map"),
        (["scans=room.npz", "weights=4d"], "4d: no such checkpoint; expected a model.safetensors, or one of 2d, 3d"),
        (["scans=room.npz", "max_range_m=-3"], "hilbertvae-map: max_range_m: expected more than min_range_m"),
    ],
)
def test_what_is_wrong_is_said_and_leaves_nothing(words, said, room, tmp_path, monkeypatch, capsys):
    npz_of(room, tmp_path / "room.npz")
    (tmp_path / "drive").mkdir()
    npz_of(room, tmp_path / "drive" / "0.npz")
    (tmp_path / "house.dwg").touch()
    (tmp_path / "broken.npz").write_bytes((tmp_path / "room.npz").read_bytes()[:300])
    monkeypatch.chdir(tmp_path)
    assert map_command.main([*words, "output=out"]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_can_not_be_written(room, tmp_path, capsys):
    """A file in the place of the folder; permissions mean nothing to root."""
    npz_of(room, tmp_path / "room.npz")
    (tmp_path / "out").write_text("mine")
    assert map_command.main([f"scans={tmp_path / 'room.npz'}", f"output={tmp_path / 'out'}"]) == 2
    said = capsys.readouterr().err
    assert "output: expected a folder" in said and "out is a file" in said and (tmp_path / "out").read_text() == "mine"


def test_a_folder_that_may_not_be_written_is_found_before_anything_is_read(tmp_path, monkeypatch, capsys):
    """By what the system says, since root may write anywhere."""
    monkeypatch.setattr("os.access", lambda *_: False)
    assert map_command.main([f"scans={tmp_path / 'nowhere.npz'}", f"output={tmp_path / 'a' / 'b'}"]) == 2
    assert f"output: {tmp_path} can't be written" in capsys.readouterr().err and not (tmp_path / "a").exists()


def test_no_map_is_written_among_the_scans_of_a_drive(tmp_path, capsys):
    (tmp_path / "drive" / "velodyne").mkdir(parents=True)
    for output in ("drive", "drive/velodyne"):
        assert map_command.main([f"scans={tmp_path / 'drive'}", f"output={tmp_path / output}"]) == 2
        assert "is the folder that is read" in capsys.readouterr().err


def test_the_file_that_is_read_is_no_folder(room, tmp_path, capsys):
    scans = npz_of(room, tmp_path / "room.npz")
    assert map_command.main([f"scans={scans}", f"output={scans}"]) == 2
    assert f"output: expected a folder, {scans} is the file that is read" in capsys.readouterr().err


def test_a_full_disk_leaves_what_was_there(room, tmp_path, monkeypatch, capsys):
    settings = MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False, exports=["npz"])
    out = make_map(settings)
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hilbertvae.mapping.write_picture", full)
    assert map_command.main([f"scans={settings.scans}", f"output={out}", "fill=off", "exports=[npz]", "resolution_m=0.2"]) == 2
    said = capsys.readouterr().err
    assert "No space left on device" in said and "out" in said
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize(("words", "told"), [(["adapt_steps=-1"], "a whole number"), (["adapt_steps=5", "fill=off"], "0 with fill=off")])
def test_steps_that_can_not_be_are_told_before_scans_are_read(tmp_path, capsys, words, told):
    assert map_command.main([f"scans={tmp_path / 'gone.npz'}", f"output={tmp_path / 'out'}", *words]) == 2
    assert f"adapt_steps: expected {told}" in capsys.readouterr().err


def test_a_disk_that_fills_up_while_the_map_is_saved(room, tmp_path):
    """Files of more than 20 kB can't be written, as by a quota: one line, and not even the folders above are left."""
    scans = npz_of(room, tmp_path / "room.npz")

    def small_files():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    command = [sys.executable, "-m", "hilbertvae.commands.map", f"scans={scans}", "output=maps/out", "fill=off"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, preexec_fn=small_files)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["room.npz"]


def test_nothing_that_is_not_an_earlier_map_is_replaced_or_taken_away(room, tmp_path, capsys):
    scans, out = npz_of(room, tmp_path / "room.npz"), tmp_path / "out"
    out.mkdir()
    (out / "map.npz").write_text("mine")
    assert map_command.main([f"scans={scans}", f"output={out}", "fill=off"]) == 2
    assert "map.npz was not left by an earlier map" in capsys.readouterr().err
    (out / "map.npz").unlink()
    (out / "data.csv").write_text("mine")
    (out / "summary.json").write_text('{"files": ["data.csv"]}')
    assert map_command.main([f"scans={scans}", f"output={out}", "fill=off"]) == 2
    assert "summary.json was not left by an earlier map" in capsys.readouterr().err
    assert (out / "data.csv").read_text() == "mine"


def test_a_map_of_our_own_is_no_scans(room, tmp_path, capsys):
    """Neither its folder, whose clouds and grids would pass for some, nor its file."""
    out = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False, exports=["npz"]))
    for given in (out, out / "map.safetensors"):
        assert map_command.main([f"scans={given}", f"output={tmp_path / 'again'}"]) == 2
        assert f"{given}: expected scans, got what hilbertvae has made; give the scans again, or" in capsys.readouterr().err


def test_the_map_that_is_filled_is_not_replaced(room, tmp_path, capsys):
    out = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False))
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for name in ("map.yaml", "map_observed.bt"):
        assert map_command.main([f"scans={out / name}", f"output={out}", "fill=off"]) == 2
        assert "is what is read" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_an_earlier_map_that_is_read_is_not_taken_away(room, tmp_path, capsys):
    """Also where this map would not write such a file, but clear away what the earlier one left."""
    out = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False))
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert map_command.main([f"scans={out / 'map_observed.ot'}", f"output={out}", "fill=off", "exports=[npz]"]) == 2
    assert "map_observed.ot is what is read" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize(
    ("name", "image"), [("map_observed.ot", None), ("map_observed.yaml", "map_observed.pgm"), ("plan.yaml", "map.pgm")]
)
def test_what_a_link_leads_to_is_not_replaced_or_taken_away(room, tmp_path, capsys, name, image):
    out = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False))
    if name == "plan.yaml":  # a file of one's own, whose image alone is a link
        (tmp_path / name).write_bytes((out / "map.yaml").read_bytes())
    else:
        (tmp_path / name).symlink_to(out / name)
    if image:
        (tmp_path / image).symlink_to(out / image)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert map_command.main([f"scans={tmp_path / name}", f"output={out}", "fill=off", "exports=[npz]"]) == 2
    assert f"output: {tmp_path / (image if name == 'plan.yaml' else name)} is what is read" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_the_image_of_the_map_that_is_filled_is_not_replaced(room, tmp_path, capsys):
    out = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), fill=False))
    (out / "plan.yaml").write_bytes((out / "map.yaml").read_bytes())
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert map_command.main([f"scans={out / 'plan.yaml'}", f"output={out}", "fill=off"]) == 2
    assert f"output: {out / 'map.pgm'} is what is read" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("steps", [0, 1])
def test_the_network_that_an_earlier_map_needs_is_not_replaced_or_taken_away(room, tmp_path, capsys, steps):
    words = [f"scans={npz_of(room, tmp_path / 'room.npz')}", f"output={tmp_path / 'out'}", "exports=[]"]
    weights = tiny_reconstructor().save(tmp_path / "tiny.safetensors")
    assert map_command.main([*words, f"weights={weights}", "adapt_steps=1"]) == 0
    network = tmp_path / "out" / "adapted.safetensors"
    before = network.read_bytes()
    assert map_command.main([*words, f"weights={network}", f"adapt_steps={steps}"]) == 2
    assert "adapted.safetensors is what is read" in capsys.readouterr().err
    assert network.read_bytes() == before


@pytest.mark.parametrize("name", ["points.npz", "map_observed.npz"])
def test_scans_that_no_file_of_a_map_would_replace_may_lie_beside_it(room, tmp_path, name):
    """Their names up to the ending don't count, in the first run and in the next."""
    scans = npz_of(room, tmp_path / name)
    before = scans.read_bytes()
    for _ in range(2):
        assert map_command.main([f"scans={scans}", f"output={tmp_path}", "fill=off", "exports=points,ot"]) == 0
    assert scans.read_bytes() == before and (tmp_path / "points.ply").exists()


def test_no_map_is_laid_among_the_scans(room, tmp_path, capsys):
    drive = tmp_path / "drive"
    drive.mkdir()
    npz_of(room, drive / "room.npz")
    assert map_command.main([f"scans={drive}", f"output={drive}", "fill=off"]) == 2
    assert "is the folder that is read" in capsys.readouterr().err
    assert [path.name for path in drive.iterdir()] == ["room.npz"]


def test_free_space_alone_is_no_map(tmp_path, capsys):
    (tmp_path / "map.pgm").write_bytes(b"P5 8 8 255\n" + bytes([254]) * 64)
    (tmp_path / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    assert map_command.main([f"scans={tmp_path / 'map.yaml'}", f"output={tmp_path / 'out'}"]) == 2
    assert "map.yaml: expected free and occupied space, found free space alone" in capsys.readouterr().err


def test_warnings_name_keys_as_this_command_has_them(tmp_path, capsys):
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(240, 2.0), [0, 0, 0])])
    assert map_command.main([f"scans={log}", f"output={tmp_path / 'out'}", "fill=off", "exports=[npz]"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "set beam_step_deg" in said and "reading." not in said


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("DefaultCPUAllocator: not enough memory: you tried to allocate 9 bytes")])
def test_too_little_memory_is_said_in_one_line(error, room, tmp_path, monkeypatch, capsys):
    def greedy(*_):
        raise error

    monkeypatch.setattr("hilbertvae.mapping.fit_cloud", greedy)
    assert map_command.main([f"scans={npz_of(room, tmp_path / 'room.npz')}", f"output={tmp_path / 'out'}"]) == 2
    assert "out of memory" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_what_does_not_fit_a_format_is_left_out_unless_it_was_asked_for(room, tmp_path, monkeypatch):
    scans = npz_of(room, tmp_path / "room.npz")

    def too_large(*_):
        raise InputError("cells: expected a box of at most 10 cells")

    monkeypatch.setitem(EXPORTS, "ros", replace(EXPORTS["ros"], write=too_large))
    with pytest.warns(UserWarning, match="ros is left out: cells: expected a box"):
        output = make_map(MapSettings(scans=str(scans), output=str(tmp_path / "out"), fill=False))
    assert (output / "map.ot").exists() and not (output / "map.pgm").exists()
    with pytest.raises(InputError, match="exports: ros: cells: expected a box"):
        make_map(MapSettings(scans=str(scans), output=str(tmp_path / "out"), fill=False, exports=["ros"]))
