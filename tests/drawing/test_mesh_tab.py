import numpy as np
import pytest
import trimesh
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.mesh import plugin_data_pb2
from torch.utils.tensorboard import SummaryWriter

from hilbertvae.checks import InputError
from hilbertvae.drawing.lit_colours import surface_colours
from hilbertvae.drawing.mesh_tab import add_surface, simplified
from hilbertvae.drawing.surface import Surface


def globe(subdivisions=4, offset=0.0):
    mesh = trimesh.creation.icosphere(subdivisions, 5.0)
    vertices = np.array(mesh.vertices) + offset
    upper = mesh.vertices[:, 2] > 0
    return Surface(vertices, np.array(mesh.faces), np.where(upper, 0.9, 0.7), np.asarray(upper))


def test_simplified_keeps_shape_and_what_was_observed():
    surface = globe()
    small = simplified(surface, 500)
    assert 200 < len(small) <= 500
    mesh = trimesh.Trimesh(small.vertices, small.faces, process=False)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 125, rel=0.1)
    assert small.observed[small.vertices[:, 2] > 1].all() and not small.observed[small.vertices[:, 2] < -1].any()
    np.testing.assert_allclose(small.probability[small.vertices[:, 2] > 1], 0.9)
    assert len(np.unique(small.faces, axis=0)) == len(small.faces)
    assert simplified(surface, len(surface)) is surface
    with pytest.raises(InputError, match="most_vertices"):
        simplified(surface, 0)


def test_colours_go_by_height_and_predicted_is_less_blue():
    surface = globe()
    colours = surface_colours(surface).astype(int)
    assert colours.shape == (len(surface), 3)
    seen = Surface(surface.vertices, surface.faces, surface.probability, np.ones(len(surface), bool))
    plain = surface_colours(seen).astype(int)
    low = ~surface.observed
    assert (colours[~low] == plain[~low]).all()
    assert ((colours - plain)[low][:, 2] < (colours - plain)[low][:, 0]).all()
    assert surface_colours(Surface(np.empty((0, 3)), np.empty((0, 3), int), np.empty(0), np.empty(0, bool))).shape == (0, 3)


@pytest.mark.parametrize("most", [300, 200_000])
def test_mesh_is_read_back_around_the_origin(tmp_path, most):
    surface = globe(offset=np.array([500_000.0, 4_500_000.0, 100.0]))
    with SummaryWriter(tmp_path) as writer:
        add_surface(writer, "room/surface", surface, most_vertices=most)
        add_surface(writer, "room/nothing", Surface(np.empty((0, 3)), np.empty((0, 3), int), np.empty(0), np.empty(0, bool)))
    events = EventAccumulator(str(tmp_path), size_guidance={"tensors": 0}).Reload()
    found = {}
    for tag in events.Tags()["tensors"]:
        metadata = plugin_data_pb2.MeshPluginData.FromString(events.SummaryMetadata(tag).plugin_data.content)
        (event,) = events.Tensors(tag)
        assert event.step == 0 and metadata.name == "room/surface"
        proto, kind = event.tensor_proto, plugin_data_pb2.MeshPluginData.ContentType.Name(metadata.content_type)
        flat = np.frombuffer(proto.tensor_content, {1: np.float32, 3: np.int32, 4: np.uint8}[proto.dtype])
        if not len(flat):
            flat = np.array(list(proto.float_val) or list(proto.int_val))
        found[kind] = flat.reshape([d.size for d in proto.tensor_shape.dim])
    assert set(found) == {"VERTEX", "FACE", "COLOR"}
    count = found["VERTEX"].shape[1]
    assert count == min(len(surface), most) or 100 < count <= most
    assert found["COLOR"].shape == (1, count, 3) and found["FACE"].max() == count - 1
    mesh = trimesh.Trimesh(found["VERTEX"][0], found["FACE"][0], process=False)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 125, rel=0.15)  # turned, not mirrored
    np.testing.assert_allclose(np.abs(mesh.vertices).max(axis=0), 5, atol=0.6)
