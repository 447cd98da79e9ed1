"""Maps of what was observed alone: `fill=off` asks only where there can be an answer, and leaves the files that asking farther would; a map
that a network could have filled says why it is not."""

import json

import numpy as np
import pytest
from map_command_toys import npz_of
from safetensors import safe_open

from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.exports.map_cells import REACH_M, MapCells
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mapping import MapSettings, make_map


def content(path):
    """The bytes of a file; of a map's, whose header comes in any order, what is in it."""
    if path.suffix != ".safetensors":
        return path.read_bytes()
    with safe_open(path, framework="np") as file:
        return file.metadata(), {name: (file.get_tensor(name).dtype, file.get_tensor(name).tobytes()) for name in file.keys()}  # noqa: SIM118


def test_asking_farther_changes_no_file(place, tmp_path, monkeypatch):
    counts, describe, sample = [0], HilbertMap.describe, MapCells.sample

    def counted(mapper, queries):
        counts[-1] += len(queries)
        return describe(mapper, queries)

    monkeypatch.setattr(HilbertMap, "describe", counted)
    monkeypatch.setattr("time.perf_counter", lambda: 0.0)  # the page and the summary say how long it took
    settings = MapSettings(scans=str(npz_of(place, tmp_path / "room.npz")), fill=False)
    settings.output = str(tmp_path / "near")
    near = make_map(settings)
    monkeypatch.setattr(MapCells, "sample", lambda mapper, points, cell_m, _, told: sample(mapper, points, cell_m, REACH_M, told))
    counts.append(0)
    settings.output = str(tmp_path / "far")
    far = make_map(settings)
    cells = read_grid(near / "map.npz")
    assert np.all(cells.observed) and counts[0] == len(cells) < counts[1] / 1.5
    names = {path.name for path in near.iterdir()}
    assert names == {path.name for path in far.iterdir()} and len(names) > 8
    for name in names - {"summary.json"}:
        assert content(near / name) == content(far / name), name
    one, other = (json.loads((folder / "summary.json").read_text()) for folder in (near, far))
    for summary in (one, other):
        del summary["git"]  # of the code, which may be worked on meanwhile
    assert one == other


def test_too_few_returns_for_a_network_are_told(tmp_path):
    np.savez(tmp_path / "few.npz", points=np.column_stack([np.full(5, 3.0), np.arange(5) * 0.3]), origins=np.zeros(2))
    with pytest.warns(UserWarning, match="few.npz: found at most 10 voxels with returns within 9.6 m, too few"):
        output = make_map(MapSettings(scans=str(tmp_path / "few.npz"), output=str(tmp_path / "out")))
    assert read_grid(output / "map.npz").observed.all()
