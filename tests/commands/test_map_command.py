"""`hilbertvae-map` from a file of scans to the files of other tools, and `hilbertvae-query` on what it wrote."""

import json
import os
import subprocess
import sys
import warnings

import numpy as np
import octomap
import pytest
import trimesh
import yaml
from map_command_toys import npz_of
from PIL import Image

import hilbertvae
from hilbertvae.commands import map as map_command
from hilbertvae.commands import query as query_command
from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.mappers.weights import RankWeights
from hilbertvae.mapping import MapSettings, make_map
from hilbertvae.voxel_blocks import SIDE
from toy_rooms import tiny_reconstructor


@pytest.fixture(scope="module")
def mapped(place, tmp_path_factory):
    """The folder that the command left for a room, its site, and the command's settings."""
    folder = tmp_path_factory.mktemp("map")
    weights = tiny_reconstructor(place.dimension).save(folder / "tiny.safetensors")
    words = [f"scans={npz_of(place, folder / 'room.npz')}", f"output={folder / 'out'}", f"weights={weights}"]
    assert map_command.main(words) == 0
    return folder / "out", place, words


def test_everything_is_there(mapped):
    output, place, _ = mapped
    summary = json.loads((output / "summary.json").read_text())
    both = {"map.safetensors", "map.png", "summary.html", "map.npz", "map.ot", "map.bt", "map_observed.ot", "map_observed.bt", "points.ply"}
    own = {"map.yaml", "map.pgm", "map_observed.yaml", "map_observed.pgm"} if place.dimension == 2 else {"mesh.ply"}
    assert set(summary["files"]) == both | own == {path.name for path in output.iterdir()} - {"summary.json"}
    assert summary["points"]["returns"] == len(place.scans) and summary["points"]["scans"] == len(np.unique(place.scans.scan))
    assert set(summary["seconds"]) == {"read", "label points", "complete grids", "ask each cell", "write"}


@pytest.mark.parametrize(("side", "reach_m"), [(256, 1.5), (4, 1.5), (2, 0.8)])
def test_a_map_is_filled_as_far_as_usual_however_small_its_blocks_are_or_it_is_said(room, tmp_path, monkeypatch, side, reach_m):
    """As those of fine cells are."""
    monkeypatch.setitem(SIDE, 2, side)
    asked, sample = [], MapCells.sample
    monkeypatch.setattr(MapCells, "sample", lambda *given: asked.append(given[3]) or sample(*given))
    settings = MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), exports=[])
    settings.weights = str(tiny_reconstructor(2).save(tmp_path / "tiny.safetensors"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        make_map(settings)
    assert asked == [pytest.approx(reach_m)]
    said = [str(warning.message) for warning in told if "gaps are filled" in str(warning.message)]
    if reach_m == 1.5:
        assert not said
    else:
        assert "room.npz: with cells of 0.1 m gaps are filled up to 0.8 m from what was seen; what is wider than 1.6 m" in said[0]


def test_the_summary_counts_the_cells(mapped):
    """Against the cells read back: before and after differ by what was filled in, and all three kinds fill the box."""
    output, place, _ = mapped
    summary, cells = json.loads((output / "summary.json").read_text()), read_grid(output / "map.npz")
    shape = np.ptp(cells.index, axis=0) + 1
    np.testing.assert_allclose(np.subtract(*(summary["extent_m"][end] for end in ("high", "low"))), shape * cells.resolution_m)
    before, after, filled = (summary["cells"][name] for name in ("before", "after", "filled"))
    assert after["occupied"] == np.count_nonzero(cells.probability > 0.6)
    assert before["free"] == np.count_nonzero(cells.observed & (cells.probability <= np.float32(0.4 + 1e-6)))
    assert before["occupied"] + filled["occupied"] == after["occupied"] and before["free"] + filled["free"] == after["free"]
    assert sum(before.values()) == sum(after.values()) == np.prod(shape)
    assert filled["occupied"] + filled["free"] > 0


def test_the_saved_map_answers_as_the_mapper_does(mapped):
    output, place, words = mapped
    loaded = hilbertvae.load_map(output / "map.safetensors")
    cloud = hilbertvae.cloud_from_scans(place.scans.points, place.scans.origins)
    mapper = hilbertvae.load_mapper(words[2].removeprefix("weights=")).fit(cloud.points, cloud.occupied, cloud.weight)
    queries = np.random.default_rng(0).uniform(cloud.points.min(axis=0) - 1, cloud.points.max(axis=0) + 1, (500, place.dimension))
    np.testing.assert_allclose(loaded.predict_proba(queries), mapper.predict_proba(queries), atol=1e-6)


def test_other_tools_read_the_same_map(mapped):
    """Occupied places of the NPZ are occupied for OctoMap's own reader, for map_server's rules, and among the points."""
    output, place, _ = mapped
    cells = read_grid(output / "map.npz")
    rng = np.random.default_rng(0)
    chosen = rng.choice(np.flatnonzero(cells.probability > 0.61), 50)
    tree = octomap.OcTree(cells.resolution_m)
    assert tree.readBinary(os.fsencode(output / "map.bt"))
    places = np.zeros((50, 3))
    places[:, : place.dimension] = cells.centres[chosen]
    places[:, place.dimension :] = cells.resolution_m / 2
    assert all(tree.isNodeOccupied(tree.search(spot)) for spot in places)
    points = trimesh.load(output / "points.ply").vertices
    assert len(points) == np.count_nonzero(cells.probability > 0.6)
    if place.dimension == 2:
        about = yaml.safe_load((output / "map.yaml").read_text())
        image = np.asarray(Image.open(output / about["image"]))
        column, row = np.floor((cells.centres[chosen] - about["origin"][:2]) / about["resolution"]).astype(int).T
        assert (image[len(image) - 1 - row, column] == 0).all()


def test_query_answers_as_the_map_does(mapped, tmp_path, capsys):
    output, place, _ = mapped
    loaded = hilbertvae.load_map(output / "map.safetensors")
    queries = np.random.default_rng(0).uniform(0, 2, (40, place.dimension))
    np.savetxt(tmp_path / "asked.txt", queries)
    capsys.readouterr()
    assert query_command.main([f"map={output}", f"points={tmp_path / 'asked.txt'}"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head == ",".join([*"xyz"[: place.dimension], "probability", "std", "observed"])
    found = np.array([[float(word) for word in line.split(",")] for line in lines])
    expected = np.column_stack([loaded.predict_map(queries), loaded.predict_std(queries), loaded.observed(queries)])
    np.testing.assert_allclose(found[:, place.dimension :], expected, atol=6e-5)
    assert query_command.main([f"map={output}", f"points={tmp_path / 'asked.txt'}", f"output={tmp_path / 'said.npz'}"]) == 0
    with np.load(tmp_path / "said.npz") as said:
        np.testing.assert_array_equal(said["probability"], expected[:, 0])
        np.testing.assert_array_equal(said["points"], np.loadtxt(tmp_path / "asked.txt"))
    if place.dimension == 2:  # as other tools write a plan's points: at one height, and no other
        np.savetxt(tmp_path / "plan.txt", np.column_stack([queries, np.full(40, 0.25)]))
        assert query_command.main([f"map={output}", f"points={tmp_path / 'plan.txt'}"]) == 0
        assert capsys.readouterr().out.splitlines() == [head, *lines]
        np.savetxt(tmp_path / "space.txt", np.column_stack([queries, np.arange(40)]))
        assert query_command.main([f"map={output}", f"points={tmp_path / 'space.txt'}"]) == 2


def test_progress_is_told_by_stage_and_share(room, tmp_path):
    said = []
    make_map(MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), exports=["npz"]), said.append)
    assert [line for line in said if "%" not in line] == ["read", "label points", "complete grids", "ask each cell", "write"]
    assert {"complete grids, 100 %", "ask each cell, 100 %"} <= set(said)


def test_without_filling_nothing_is_predicted(room, tmp_path):
    scans = npz_of(room, tmp_path / "room.npz")
    output = make_map(MapSettings(scans=str(scans), output=str(tmp_path / "out"), fill=False, exports=["npz"]))
    cells = read_grid(output / "map.npz")
    assert cells.observed.all()
    filled = json.loads((output / "summary.json").read_text())["cells"]["filled"]
    assert set(filled.values()) == {0}


def test_the_network_may_learn_from_the_scans_first(mapped, tmp_path):
    output, _, words = mapped
    learned = tmp_path / "learned"
    assert map_command.main([words[0], words[2], f"output={learned}", "adapt_steps=1", "exports=[npz]"]) == 0
    plain, found = read_grid(output / "map.npz"), read_grid(learned / "map.npz")
    np.testing.assert_array_equal(plain.index[plain.observed], found.index[found.observed])
    said = [dict(zip(map(tuple, cells.index), cells.probability, strict=True)) for cells in (plain, found)]
    assert any(said[0][cell] != said[1][cell] for cell in said[0].keys() & said[1].keys())
    assert json.loads((learned / "summary.json").read_text())["adapt_steps"] == 1


def test_a_map_whose_network_learned_grows_with_what_lies_beside_it(room, tmp_path):
    settings = MapSettings(scans=str(npz_of(room, tmp_path / "room.npz")), output=str(tmp_path / "out"), adapt_steps=1, exports=[])
    settings.weights = str(tiny_reconstructor(2).save(tmp_path / "tiny.safetensors"))
    output, part = make_map(settings), room.fit.select(slice(200))
    assert "adapted.safetensors" in json.loads((output / "summary.json").read_text())["files"]
    grown = hilbertvae.load_map(output / "map.safetensors").partial_fit(part.points, part.occupied, part.weight)
    given = hilbertvae.load_map(output / "map.safetensors", checkpoint=output / "adapted.safetensors")
    given.partial_fit(part.points, part.occupied, part.weight)
    np.testing.assert_array_equal(grown.predict_proba(room.fit.points), given.predict_proba(room.fit.points))
    settings.adapt_steps = 0
    assert not (make_map(settings) / "adapted.safetensors").exists()


def test_the_calibration_is_the_user_s(room, tmp_path):
    scans, network = npz_of(room, tmp_path / "room.npz"), tiny_reconstructor()
    for reading, constant in (("voxels", -1.0), ("points", 1.0)):
        network.map_weights[reading] = RankWeights(np.append(np.full(5, 0.1), constant), np.full(18, 0.1), np.full(6, 0.1)).plain()
    weights, filled = str(network.save(tmp_path / "learned.safetensors")), {}
    for reading in ("voxels", "points"):
        settings = MapSettings(scans=str(scans), output=str(tmp_path / reading), weights=weights, calibration=reading, exports=["npz"])
        output = make_map(settings)
        summary = json.loads((output / "summary.json").read_text())
        assert summary["calibration"] == reading == hilbertvae.load_map(output / "map.safetensors").calibration
        filled[reading] = summary["cells"]["filled"]["occupied"]
    assert filled["points"] > filled["voxels"]


def test_a_map_is_filled_from_a_map(mapped, tmp_path):
    """What `map_observed` has is taken as what was observed, and comes out as it was."""
    output, place, words = mapped
    given = output / ("map_observed.yaml" if place.dimension == 2 else "map_observed.bt")
    again = make_map(MapSettings(scans=str(given), output=str(tmp_path), weights=words[2].removeprefix("weights="), exports=["npz"]))
    before, after = read_grid(output / "map.npz"), read_grid(again / "map.npz")
    before = before.select(before.observed)
    seen = dict(zip(map(tuple, before.index), before.occupied, strict=True))
    agree = [hit == seen[index] for index, hit in zip(map(tuple, after.index), after.occupied, strict=True) if index in seen]
    assert np.mean(agree) > 0.97 and len(agree) > 0.9 * len(seen)


@pytest.mark.parametrize("fill", [False, True])
def test_a_coarser_map_keeps_its_walls(room, tmp_path, fill):
    scans = npz_of(room, tmp_path / "room.npz")
    maps = {}
    for resolution_m in (None, 0.3):
        settings = MapSettings(scans=str(scans), output=str(tmp_path / str(resolution_m)), fill=fill, exports=["npz"])
        settings.resolution_m = resolution_m
        maps[resolution_m] = read_grid(make_map(settings) / "map.npz")
    assert maps[0.3].resolution_m == 0.3
    fine, coarse = maps[None], dict(zip(map(tuple, maps[0.3].index), maps[0.3].occupied, strict=True))
    assert all(coarse[tuple(np.floor(spot / 0.3).astype(int))] for spot in fine.centres[fine.occupied])


def test_a_second_map_leaves_nothing_of_the_first(room, tmp_path):
    """Files that only the first has go; what somebody else put there stays."""
    scans, out = npz_of(room, tmp_path / "room.npz"), tmp_path / "out"
    make_map(MapSettings(scans=str(scans), output=str(out), fill=False))
    (out / "notes.txt").write_text("mine")
    assert (out / "map.ot").exists()
    make_map(MapSettings(scans=str(scans), output=str(out), fill=False, exports=["npz"], resolution_m=0.25))
    assert {path.name for path in out.iterdir()} == {"notes.txt", "map.npz", "map.png", "map.safetensors", "summary.html", "summary.json"}


def test_a_map_that_was_filled_before_is_told(mapped, tmp_path):
    output, place, words = mapped
    if place.dimension == 3:
        pytest.skip("OctoMap's files have no place for it")
    settings = MapSettings(scans=str(output / "map.yaml"), output=str(tmp_path), weights=words[2].removeprefix("weights="), exports=[])
    with pytest.warns(UserWarning, match="map_observed.yaml has what was"):
        make_map(settings)


def test_help_names_every_key(capsys):
    assert map_command.main(["--help"]) == 0
    said = capsys.readouterr().out
    expected = {"fill=on": "observed map alone", "every=1": "exports=ros,points", "poses=null": "kiss_icp", "max_range_m=null": "Metres"}
    for key, text in expected.items():
        assert key in said and text in said


def test_as_a_command_of_its_own(room, tmp_path):
    """Exit codes and streams of a process: bad input is 2, with one line and no traceback."""
    done = subprocess.run([sys.executable, "-m", "hilbertvae.commands.map", "scans=nowhere"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1 and "nowhere" in done.stderr
