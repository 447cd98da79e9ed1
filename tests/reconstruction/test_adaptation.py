from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import expit

from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud
from hilbertvae.grids.cluster_grids import GridSettings, labels_of
from hilbertvae.grids.training_grids import gapped_grids
from hilbertvae.reconstruction import adaptation
from hilbertvae.reconstruction.adaptation import adapted, batch_size
from hilbertvae.reconstruction.blocks import Reconstruction
from hilbertvae.reconstruction.settings import LikelihoodSettings
from toy_rooms import tiny_grid, tiny_reconstructor


def pairs_of(place, seed, detailed=False):
    network = tiny_reconstructor(place.dimension)
    return gapped_grids(fit_cloud(place.scans, place.resolution_m), place.resolution_m, network.grid, (1.0, 1.5), seed, detailed, most=200)


def hidden_loss(network, pairs):
    """Mean negative log-likelihood of the cells that gaps removed."""
    shown, target = pairs
    chance = expit(network.reconstruct(shown, flips=1))
    shown = labels_of(shown, network.dimension)
    hidden = (shown == 0) & (target != 0)
    return -np.log(np.where(target > 0, chance, 1 - chance)[hidden]).mean()


def weights_of(network):
    return {name: tensor.clone() for name, tensor in network.network.state_dict().items()}


@pytest.mark.parametrize("encoding", ["hit_free", "detailed"])
def test_it_learns_what_other_gaps_of_the_site_hide(place, encoding, monkeypatch):
    monkeypatch.setattr(adaptation, "LEARNING_RATE", 1e-2)  # a network that was never trained has far to go
    before = tiny_reconstructor(place.dimension, encoding=encoding)
    pairs, other = (pairs_of(place, seed, before.detailed) for seed in (1, 2))
    kept, state = weights_of(before), torch.random.get_rng_state()
    after = adapted(before, *pairs, before.grid, steps=40, seed=0)
    assert torch.equal(torch.random.get_rng_state(), state)
    assert hidden_loss(after, other) < 0.9 * hidden_loss(before, other)
    for name, tensor in weights_of(before).items():
        assert torch.equal(tensor, kept[name])
    assert after.map_weights == before.map_weights and after.grid == before.grid
    assert not after.network.training


def test_the_seed_decides(room):
    before, pairs = tiny_reconstructor(), pairs_of(room, 1)
    one, same, other = (adapted(before, *pairs, before.grid, steps=3, seed=seed).fingerprint() for seed in (0, 0, 1))
    assert one == same != other
    with torch.no_grad():
        assert adapted(before, *pairs, before.grid, steps=3, seed=0).fingerprint() == one
    with torch.inference_mode():
        assert adapted(before, *pairs, before.grid, steps=3, seed=0).fingerprint() == one


def test_what_nobody_saw_is_answered_as_before(room, monkeypatch):
    """Cells that even the uncut site does not know move less with the term that holds them than without it."""
    monkeypatch.setattr(adaptation, "LEARNING_RATE", 5e-3)
    before, pairs = tiny_reconstructor(), pairs_of(room, 1)
    # As much as a cell's label, so that rounding, of bfloat16 where there is such, does not decide.
    before = replace(before, likelihood=replace(before.likelihood, known_weight=1.0))

    def moved():
        after = adapted(before, *pairs, before.grid, steps=40, seed=0)
        asked = before.complete(pairs[0], flips=1), after.complete(pairs[0], flips=1)
        unknown = pairs[1] == 0
        logits = np.abs(np.subtract(*(np.float32(found.value) for found in asked)))[unknown].mean()
        return logits, np.abs(np.subtract(*(np.float32(found.known) for found in asked))).mean()

    held = moved()
    monkeypatch.setattr(adaptation, "_kept", lambda found, said, unknown, known_weight: 0.0)
    free = moved()
    assert held[0] < 0.85 * free[0]
    assert held[1] < 0.95 * free[1]


def test_divergence_is_that_of_two_coins():
    logit, before = torch.linspace(-6, 6, 25), torch.linspace(5, -7, 25)
    p, q = expit(before.double().numpy()), expit(logit.double().numpy())
    wanted = p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))
    np.testing.assert_allclose(adaptation._divergence(logit, before), wanted, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(adaptation._divergence(before, before), 0, atol=1e-6)


@pytest.mark.parametrize("shape", [(3, 4, 5), (2, 3, 4, 5)])
def test_what_is_kept_by_an_explicit_loop(shape):
    """How the network's answers differ counts by how likely a cell is to be seen, where nobody saw it; which cells would be, everywhere."""
    rng = np.random.default_rng(0)
    output, known, before, likely = torch.from_numpy(rng.normal(0, 2, (4, *shape)))
    unknown, wanted = rng.random(shape) < 0.6, np.zeros(shape[0])
    for cell in np.ndindex(shape):
        apart, other = (adaptation._divergence(*pair).item() for pair in ((output[cell], before[cell]), (known[cell], likely[cell])))
        wanted[cell[0]] += apart * expit(likely[cell].item()) * unknown[cell] + 0.3 * other
    found, said = Reconstruction(output, None, None, known), Reconstruction(before, None, None, likely)
    np.testing.assert_allclose(adaptation._kept(found, said, torch.from_numpy(unknown), 0.3), wanted, rtol=1e-4)


def test_a_batch_has_as_many_cells_whatever_the_grid():
    assert batch_size(tiny_grid(), 2) == 2**16 // 16**2
    assert batch_size(tiny_grid(3), 3) == 2**16 // 16**3
    assert batch_size(tiny_grid(cells=512), 2) == 1


def test_gaps_are_as_large_in_metres_whatever_the_cells():
    for grid, balls in ((GridSettings(cells=64, cluster_diameter_m=6.4), 2), (GridSettings(cells=32, cluster_diameter_m=12.8), 8)):
        found = adaptation._augmentation(grid)
        np.testing.assert_allclose(np.multiply(found.ball_diameter_cells, grid.cell_m), [1.0, 3.5])
        assert found.balls == balls


def test_networks_of_another_kind_are_refused(room):
    pairs = pairs_of(room, 1)
    silent = tiny_reconstructor(known=False)
    squared = tiny_reconstructor()
    squared.likelihood = LikelihoodSettings(kind="gaussian")
    for network in (silent, squared):
        with pytest.raises(InputError, match="adapt_steps: expected a network that answers with logits"):
            adapted(network, *pairs, network.grid, steps=1, seed=0)


def test_threads_and_large_seeds_change_nothing(room):
    before, pairs = tiny_reconstructor(), pairs_of(room, 1)
    state = torch.random.get_rng_state()
    alone = adapted(before, *pairs, before.grid, steps=3, seed=0).fingerprint()
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda seed: adapted(before, *pairs, before.grid, steps=3, seed=seed).fingerprint(), [0, 0, 2**64]))
    assert together[:2] == [alone] * 2 and together[2] != alone
    assert torch.equal(torch.random.get_rng_state(), state)
