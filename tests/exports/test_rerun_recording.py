import os
import subprocess
import sys

import numpy as np
import pytest
from export_toys import UTM, random_cells

from hilbertvae.checks import InputError
from hilbertvae.exports.rerun_recording import write_rerun


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("offset_m", [0.0, UTM])
def test_rerun_reads_observed_and_predicted_cells(tmp_path, dimension, offset_m):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    from rerun.chunk import RrdReader

    cells = random_cells(dimension, offset_m=offset_m if np.isscalar(offset_m) else offset_m[:dimension])
    path = write_rerun(cells, tmp_path / "map.rrd")
    assert [file.name for file in tmp_path.iterdir()] == ["map.rrd"]
    chunks = {chunk.entity_path: chunk.to_record_batch().to_pydict() for chunk in RrdReader(path).stream()}
    origin = np.array(chunks["/map"]["origin_m"][0]).ravel()
    for name, part in (("/map/observed", cells.observed), ("/map/predicted", ~cells.observed)):
        chosen = cells.select(part & cells.occupied)
        places = np.array(chunks[name]["Points3D:positions"][0]).reshape(-1, 3) + origin
        np.testing.assert_allclose(places[:, :dimension], chosen.centres, atol=1e-3)
        np.testing.assert_array_equal(places[:, dimension:], 0)
        np.testing.assert_allclose(chunks[name]["probability"][0], chosen.probability)
        assert len(chunks[name]["Points3D:colors"][0]) == len(chosen)


def test_a_map_without_predictions_is_a_recording_too(tmp_path, recwarn):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    from rerun.chunk import RrdReader

    cells = random_cells(3)
    cells.observed[:] = True
    paths = {chunk.entity_path for chunk in RrdReader(write_rerun(cells, tmp_path / "map.rrd")).stream()}
    assert "/map/observed" in paths and not recwarn.list


def test_where_rerun_is_switched_off_nothing_is_written(tmp_path):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    write = "from export_toys import random_cells; from hilbertvae.exports.rerun_recording import write_rerun"
    command = [sys.executable, "-c", f"{write}; write_rerun(random_cells(2), {str(tmp_path / 'map.rrd')!r})"]
    environment = {**os.environ, "RERUN": "off", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0 and "map.rrd: Rerun is switched off by the environment variable RERUN" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_the_error_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"map.rrd: needs the extra 'rerun'.*hilbertvae\[rerun\]"):
        write_rerun(random_cells(2), tmp_path / "map.rrd")
    with pytest.raises(InputError, match="ends in .rrd"):
        write_rerun(random_cells(2), tmp_path / "map.rr")
    assert list(tmp_path.iterdir()) == []
