import copy
import json
import os
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import CHANNELS_LAST
from hilbertvae.reconstruction.paper_network import PaperNetwork
from hilbertvae.reconstruction.reconstructor import FORMAT, Reconstructor
from hilbertvae.reconstruction.settings import LikelihoodSettings, PaperNetworkSettings
from toy_rooms import draw_weights, tiny_grid, tiny_reconstructor


def codes(dimension=2, batch=5, cells=16):
    return np.random.default_rng(0).integers(-1, 2, (batch, *(cells,) * dimension)).astype(np.int8)


def paper_reconstructor(tied):
    torch.manual_seed(0)
    settings = PaperNetworkSettings(channels=[3, 4], kernels=[5, 3], latent=6, tied=tied)
    network = PaperNetwork(settings, 2, 16)
    draw_weights(network)
    return Reconstructor(network, settings, LikelihoodSettings(kind="gaussian"), tiny_grid(), 2, 0.1)


@pytest.mark.parametrize("kind", ["gated", "gated-3d", "paper", "paper-tied"])
def test_what_was_saved_comes_back_to_the_bit(tmp_path, kind):
    made = tiny_reconstructor(3 if kind == "gated-3d" else 2) if kind.startswith("gated") else paper_reconstructor(kind == "paper-tied")
    made.map_weights = {"voxels": {"unseen": [0.1, 0.2], "seen": [1 / 3]}}
    made.card = {"trained_on": ["aces"], "epoch": 3}
    path = made.save(tmp_path / "deep" / "model.safetensors")
    found = Reconstructor.load(path)
    for name in ("network_settings", "likelihood", "grid", "dimension", "resolution_m", "map_weights", "card"):
        assert getattr(found, name) == getattr(made, name)
    for (name, ours), (other, theirs) in zip(made.network.state_dict().items(), found.network.state_dict().items(), strict=True):
        assert name == other and torch.equal(ours, theirs)
    grids = codes(made.dimension)
    made.network = made.network.to(memory_format=CHANNELS_LAST[made.dimension])  # as a loaded one lies
    np.testing.assert_array_equal(found.reconstruct(grids), made.reconstruct(grids))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("flips", [1, 4, 8])
def test_the_mean_over_symmetries_by_hand(dimension, flips):
    """Each flipped copy is reconstructed and flipped back; kernel values are averaged."""
    made, grids = tiny_reconstructor(dimension), codes(dimension)
    turns = [(False, ()), (False, (0,)), (False, (1,)), (False, (0, 1)), (True, ()), (True, (0,)), (True, (1,)), (True, (0, 1))]
    total = np.zeros(grids.shape)
    for swap, axes in turns[:flips]:
        moved = grids.swapaxes(1, 2) if swap else grids
        moved = np.flip(moved, [axis + 1 for axis in axes])
        value = made.reconstruct(np.ascontiguousarray(moved), flips=1)
        value = np.flip(value, [axis + 1 for axis in axes])
        total += value.swapaxes(1, 2) if swap else value
    np.testing.assert_allclose(made.reconstruct(grids, flips=flips), total / flips, rtol=2e-3, atol=1e-3)  # kept as float16


def test_kernel_values_are_clipped_logits():
    made, grids = tiny_reconstructor(), codes()
    with torch.no_grad():
        for parameter in made.network.head.parameters():
            parameter.mul_(1e3)
    values = made.reconstruct(grids, flips=1)
    assert values.dtype == np.float32 and values.min() == -8.0 and values.max() == 8.0


def test_kernel_values_of_the_papers_network_are_its_tanh_outputs():
    values = paper_reconstructor(tied=False).reconstruct(codes())
    assert np.abs(values).max() < 1 and np.abs(values).max() > 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_batches_change_nothing_beyond_rounding(dimension):
    """In bfloat16 (8 bits) a batch of another size may take another convolution, so the last bits can differ, and no more."""
    made, grids = tiny_reconstructor(dimension), codes(dimension, batch=7)
    whole = made.reconstruct(grids)
    for batch in (1, 2, 3):
        np.testing.assert_allclose(made.complete(grids, batch=batch).value, whole, rtol=0, atol=0.02 * np.abs(whole).max())
    order = np.random.default_rng(1).permutation(7)
    np.testing.assert_allclose(made.reconstruct(grids[order]), whole[order], rtol=0, atol=0.02 * np.abs(whole).max())


def test_the_same_grids_give_the_same_bits_and_training_mode_is_off():
    made, grids = tiny_reconstructor(), codes()
    made.network.train()
    np.testing.assert_array_equal(made.reconstruct(grids), made.reconstruct(grids))


def test_no_grids():
    assert tiny_reconstructor().reconstruct(np.empty((0, 16, 16), np.int8)).shape == (0, 16, 16)


def test_it_is_pickled_as_the_cpu_can_read_it(monkeypatch):
    """What computed on a GPU last lies there; `meta` stands for it, which can't be copied back, so the copy is looked at."""
    ours, grids = tiny_reconstructor(), np.random.default_rng(0).integers(-1, 2, (2, 16, 16)).astype(np.int8)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(ours)).reconstruct(grids), ours.reconstruct(grids))
    assert ours.__getstate__()["network"] is ours.network
    elsewhere, copied = replace(ours, network=copy.deepcopy(ours.network).to("meta")), []
    monkeypatch.setattr(torch.nn.Module, "cpu", lambda network: copied.append(network) or "on the CPU")
    assert elsewhere.__getstate__()["network"] == "on the CPU"
    assert copied[0] is not elsewhere.network and type(copied[0]) is type(ours.network)


def test_what_it_is_fits_in_a_line():
    assert repr(tiny_reconstructor()) == "Reconstructor(gated, 2D, 16 cells of 0.1 m)"


def test_a_missing_checkpoint(tmp_path):
    with pytest.raises(InputError, match="nowhere.safetensors: no such checkpoint"):
        Reconstructor.load(tmp_path / "nowhere.safetensors")
    with pytest.raises(InputError, match="no such checkpoint"):
        Reconstructor.load(tmp_path)


@pytest.mark.parametrize("left", [0, 5, 100, 0.5, 0.99])
def test_a_truncated_checkpoint(tmp_path, left):
    path = tiny_reconstructor().save(tmp_path / "model.safetensors")
    size = os.path.getsize(path)
    os.truncate(path, int(left * size) if isinstance(left, float) else left)
    with pytest.raises(InputError, match="model.safetensors: not a checkpoint of hilbertvae, or damaged"):
        Reconstructor.load(path)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n" + bytes(200), pickle.dumps({"state_dict": {}}), b"\xff" * 64])
def test_a_foreign_file(tmp_path, content):
    path = tmp_path / "foreign.ckpt"
    path.write_bytes(content)
    with pytest.raises(InputError, match="foreign.ckpt: not a checkpoint of hilbertvae"):
        Reconstructor.load(path)


@pytest.mark.parametrize("metadata", [None, {"format": "pt"}])
def test_a_safetensors_file_of_others(tmp_path, metadata):
    path = tmp_path / "other.safetensors"
    save_file({"weight": torch.zeros(3)}, path, metadata=metadata)
    with pytest.raises(InputError, match="other.safetensors: a safetensors file, but not a checkpoint of hilbertvae"):
        Reconstructor.load(path)


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ("hilbertvae-reconstructor-2", "a network of another version (hilbertvae-reconstructor-2), expected hilbertvae-reconstructor-1"),
        ("hilbertvae-map-2", "a map, which load_map reads; expected a network"),
    ],
)
def test_a_file_of_ours_that_is_no_checkpoint_of_this_version(tmp_path, found, message):
    save_file({"weight": torch.zeros(3)}, tmp_path / "ours.safetensors", metadata={"format": found})
    with pytest.raises(InputError, match=re.escape(f"ours.safetensors: {message}")):
        Reconstructor.load(tmp_path / "ours.safetensors")


def forged(path, change):
    """The checkpoint at `path` with its settings changed by `change`."""
    with safe_open(path, framework="pt") as file:
        described = json.loads(file.metadata()["settings"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    described = change(described)
    save_file(tensors, path, metadata={"format": FORMAT, "settings": described if isinstance(described, str) else json.dumps(described)})
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda described: "not json",
        lambda described: [],
        lambda described: {**described, "network": {**described["network"], "channels": [8, 8]}},
        lambda described: {**described, "network": {**described["network"], "colour": "red"}},
        lambda described: {**described, "network": ["gated"]},
        lambda described: {**described, "grid": {}},
        lambda described: {**described, "dimension": 7},
        lambda described: {**described, "dimension": 3},
        lambda described: {**described, "likelihood": {"colour": "red"}},
        lambda described: {key: value for key, value in described.items() if key != "network"},
        lambda described: {key: value for key, value in described.items() if key != "weights"},
        lambda described: {**described, "resolution_m": -1},
        lambda described: {**described, "resolution_m": None},
        lambda described: {**described, "weights": None},
        lambda described: {**described, "weights": {"voxels": [1]}},
        lambda described: {**described, "weights": {"voxels": {"unseen": ["a"]}}},
        lambda described: {**described, "weights": {"voxels": {"unseen": [float("nan")]}}},
        lambda described: {**described, "weights": {"pixels": {"unseen": [0.1]}}},
        lambda described: {**described, "card": None},
        lambda described: json.dumps(described).replace('"dimension": 2', '"dimension": ' + "2" * 5000),
    ],
)
def test_settings_that_do_not_fit_the_weights(tmp_path, change):
    path = forged(tiny_reconstructor().save(tmp_path / "model.safetensors"), change)
    with pytest.raises(InputError, match="model.safetensors: the checkpoint's settings and weights don't fit together"):
        Reconstructor.load(path)


def test_a_checkpoint_from_before_there_was_a_choice_of_start(tmp_path):
    def before(described):
        return {**described, "grid": {key: value for key, value in described["grid"].items() if key != "start"}}

    made = tiny_reconstructor()
    made.grid.start = "ask_means"
    path = made.save(tmp_path / "model.safetensors")
    assert Reconstructor.load(path).grid.start == "ask_means"
    assert Reconstructor.load(forged(path, before)).grid == tiny_grid()


@pytest.mark.parametrize(("what", "table"), [("network", "gated, conditional, paper"), ("likelihood", "bernoulli, gaussian")])
def test_a_kind_that_is_not_registered_is_named_and_what_to_do(tmp_path, what, table):
    """As of a network of one's own in a process that has not imported it; the file is well."""
    path = forged(
        tiny_reconstructor().save(tmp_path / "model.safetensors"),
        lambda described: {**described, what: {**described[what], "kind": "plain"}},
    )
    expected = (
        f"model.safetensors: a {what} of kind 'plain', and there are {table} here; import what puts one of your own into {what.upper()}S"
    )
    with pytest.raises(InputError, match=expected):
        Reconstructor.load(path)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_detailed_network_over_symmetries_by_hand(tmp_path, dimension):
    made = Reconstructor.load(tiny_reconstructor(dimension, encoding="detailed").save(tmp_path / "model.safetensors"))
    rng = np.random.default_rng(0)
    grids = np.concatenate(
        [codes(dimension)[:, None], rng.integers(0, 100, (5, 2 + dimension, *(16,) * dimension)).astype(np.int8)], axis=1
    )
    assert made.detailed and not tiny_reconstructor(dimension).detailed
    total = 0.0
    for axes in ((), (0,), (1,), (0, 1)):
        moved = np.flip(grids, [axis + 2 for axis in axes]).copy()
        for axis in axes:
            moved[:, 3 + axis] *= -1
        total = total + np.flip(made.reconstruct(moved, flips=1), [axis + 1 for axis in axes])
    found = made.complete(grids, flips=4)
    np.testing.assert_allclose(found.value, total / 4, rtol=2e-3, atol=1e-3)
    assert (found.known[grids[:, 0] != 0] == 255).all() and (found.known[grids[:, 0] == 0] < 255).any()
    plain = grids.copy()
    plain[:, 1:] = 0
    assert (made.reconstruct(plain) != made.reconstruct(grids)).any()


@pytest.mark.parametrize("flips", [0, 3, 16])
def test_symmetries_that_are_no_group_are_refused(flips):
    made = tiny_reconstructor()
    with pytest.raises(InputError, match=f"flips: expected 1, 2, 4 or 8, got {flips}"):
        made.reconstruct(np.zeros((1, made.grid.cells, made.grid.cells), np.int8), flips=flips)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("flips", [1, 4, 8])
def test_what_would_be_known_over_symmetries_by_hand(dimension, flips):
    made = tiny_reconstructor(dimension)
    grids = np.random.default_rng(0).integers(-1, 2, (5, *(16,) * dimension)).astype(np.int8)
    total, turns = np.zeros(grids.shape), [(swap, axes) for swap in (False, True) for axes in ((), (0,), (1,), (0, 1))]
    for swap, axes in turns[:flips]:
        moved = np.flip(grids.swapaxes(1, 2) if swap else grids, [axis + 1 for axis in axes])
        known = np.flip(made.complete(np.ascontiguousarray(moved), flips=1).known, [axis + 1 for axis in axes])
        total += known.swapaxes(1, 2) if swap else known
    found, unknown = made.complete(grids, flips=flips).known, grids == 0
    np.testing.assert_allclose(found[unknown], total[unknown] / flips, rtol=0, atol=1.01)  # each was rounded
    assert found[unknown].std() > 2 and (found[~unknown] == 255).all()


def test_weights_that_are_no_numbers_and_scales_of_another_shape_are_refused(tmp_path):
    made = tiny_reconstructor()
    next(made.network.parameters()).data.fill_(np.nan)
    with pytest.raises(InputError, match="model.safetensors: .*expected finite weights, got NaN or inf"):
        Reconstructor.load(made.save(tmp_path / "model.safetensors"))
    path = tiny_reconstructor().save(tmp_path / "packed.safetensors", packed=True)
    with safe_open(path, framework="pt") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    scale = next(name for name in tensors if name.endswith(".scale"))
    save_file(tensors | {scale: tensors[scale][:1]}, path, metadata=metadata)
    with pytest.raises(InputError, match=f"packed.safetensors: .*{scale}: expected shape .* a scale per channel"):
        Reconstructor.load(path)


def test_a_default_of_torch_changes_no_network(tmp_path):
    path = tiny_reconstructor().save(tmp_path / "model.safetensors")
    usual = Reconstructor.load(path).fingerprint()
    before = torch.get_default_dtype()
    try:
        torch.set_default_dtype(torch.float64)
        assert Reconstructor.load(path).fingerprint() == usual
    finally:
        torch.set_default_dtype(before)


def test_loading_draws_no_random_numbers(tmp_path):
    """Of the caller's, whose program they are."""
    path, before = tiny_reconstructor().save(tmp_path / "model.safetensors"), torch.get_rng_state()
    Reconstructor.load(path).check_cells(8)
    assert torch.equal(torch.get_rng_state(), before)
