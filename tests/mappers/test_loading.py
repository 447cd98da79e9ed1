import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reconstruction.reconstructor import Reconstructor
from toy_rooms import tiny_reconstructor


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_mapper_from_a_checkpoint_maps_a_new_cloud(tmp_path, monkeypatch, room, box, dimension):
    """No config folder and no site: a file, a list of scans, and queries."""
    made = tiny_reconstructor(dimension)
    path = made.save(tmp_path / "model.safetensors")
    monkeypatch.chdir(tmp_path)
    scans = {2: room, 3: box}[dimension].scans
    sweeps = [scans.points[scans.scan == k] for k in range(5)]
    cloud = hilbertvae.cloud_from_scans(sweeps, [scans.origins[scans.scan == k][0] for k in range(5)])
    mapper = hilbertvae.load_mapper(path, neighbours=3)
    with pytest.raises(NotFittedError):
        mapper.predict_proba(cloud.points)
    found = mapper.fit(cloud.points, cloud.occupied, cloud.weight).predict_proba(cloud.points)
    expected = HilbertMap(made, neighbours=3).fit(cloud.points, cloud.occupied, cloud.weight).predict_proba(cloud.points)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3)
    assert found[cloud.occupied, 1].mean() > found[~cloud.occupied, 1].mean()


def test_a_cloud_needs_no_weights(tmp_path, room):
    mapper = hilbertvae.load_mapper(tiny_reconstructor().save(tmp_path / "model.safetensors"))
    cloud = room.fit
    given = mapper.fit(cloud.points, cloud.occupied, np.ones(len(cloud))).predict_proba(cloud.points)
    np.testing.assert_array_equal(mapper.fit(cloud.points, cloud.occupied).predict_proba(cloud.points), given)


def test_what_is_no_checkpoint(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a network")
    with pytest.raises(InputError, match="notes.txt: not a checkpoint of hilbertvae"):
        hilbertvae.load_mapper(path)
    with pytest.raises(InputError, match="no such checkpoint"):
        hilbertvae.load_mapper(tmp_path / "model.safetensors")


def test_settings_of_no_mapper(tmp_path):
    path = tiny_reconstructor().save(tmp_path / "model.safetensors")
    with pytest.raises(TypeError, match="colour"):
        hilbertvae.load_mapper(path, colour="red")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unseen": [0.1, 0.2]}, r"weights.voxels.everywhere: expected \(2,\) finite numbers, got shape \(6,\)"),
        ({"unseen": 0.1}, r"weights.voxels.unseen: expected \(1,\) finite numbers, got shape \(\)"),
        ({"everywhere": [0.1]}, "weights.voxels.everywhere: expected"),
        ({"beyond": [0.1]}, "weights.voxels.beyond: expected"),
        ({"spread": [0.1]}, "weights.voxels: "),
        ({"louder": 1.0}, "weights.voxels: .*learned by another version"),
    ],
)
def test_weights_that_are_no_map_s_are_refused_by_the_name_of_the_file(tmp_path, room, change, message):
    """And where a map is made with a network that was read otherwise."""
    made = tiny_reconstructor()
    made.map_weights = {"voxels": {**Reconstructor.load("2d").map_weights["voxels"], **change}}
    path = made.save(tmp_path / "model.safetensors")
    with pytest.raises(InputError, match=f"model.safetensors: {message}"):
        hilbertvae.load_mapper(path)
    with pytest.raises((InputError, TypeError)):
        HilbertMap(made).fit(room.fit.points, room.fit.occupied, room.fit.weight)
