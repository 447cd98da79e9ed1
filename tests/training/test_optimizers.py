"""Muon against its definition in numpy, its other parameters against AdamW, and both through a saved state."""

import copy
import math

import numpy as np
import pytest
import torch
from torch import nn

from hilbertvae.checks import InputError
from hilbertvae.training.optimizers import NEWTON_SCHULZ, OPTIMIZERS, ROUNDS, Muon, orthogonalised, parameter_groups
from hilbertvae.training.trainer_settings import OPTIMIZER_KINDS, TrainerSettings

RATE, DECAY = 0.01, 0.1


def network():
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(3, 8, 3), nn.GroupNorm(2, 8), nn.Flatten(), nn.Linear(8 * 4 * 4, 5))


def take(model, optimizer, steps, seed=1):
    generator = torch.Generator().manual_seed(seed)
    for _ in range(steps):
        optimizer.zero_grad()
        model(torch.randn(16, 3, 6, 6, generator=generator)).square().mean().backward()
        optimizer.step()


@pytest.mark.parametrize("shape", [(8, 27), (27, 8), (16, 16), (1, 9), (64, 576)])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_no_direction_is_lost_and_none_is_loud(shape, scale):
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * scale
    u, s, vt = np.linalg.svd(matrix.numpy(), full_matrices=False)
    found = orthogonalised(matrix.float()).double().numpy()
    assert found.shape == shape
    within = u.T @ found @ vt.T  # diagonal if the directions are those of the matrix
    wanted = s > s.max() / 20  # five rounds raise smaller ones less
    assert (np.diag(within)[wanted] > 0.6).all() and (np.diag(within)[wanted] < 1.3).all()
    assert np.abs(within - np.diag(np.diag(within))).max() < 1e-3


@pytest.mark.parametrize("shape", [(8, 27), (27, 8), (1, 9), (64, 576)])
@pytest.mark.parametrize("decades", [0, 3, 8])
def test_as_round_by_round(shape, decades):
    """The rounds written out, as the paper has them, also where singular values are orders of magnitude apart."""
    generator = torch.Generator().manual_seed(0)
    matrix = torch.randn(shape, generator=generator, dtype=torch.float64) * torch.logspace(0, -decades, shape[1], dtype=torch.float64)
    x = matrix / matrix.norm()
    for _ in range(ROUNDS):
        square = x @ x.T
        x = NEWTON_SCHULZ[0] * x + (NEWTON_SCHULZ[1] * square + NEWTON_SCHULZ[2] * square @ square) @ x
    np.testing.assert_allclose(orthogonalised(matrix.float()).numpy(), x.numpy(), atol=1e-3)


def test_a_gradient_of_zero_moves_nothing():
    assert (orthogonalised(torch.zeros(4, 6)) == 0).all()


def test_convolutions_take_the_orthogonalised_momentum():
    model = network()
    weights = model[0].weight
    before, mean = weights.detach().double().numpy().copy(), np.zeros(weights.shape)
    optimizer = Muon(model, RATE, DECAY)
    generator = torch.Generator().manual_seed(1)
    for _ in range(3):
        gradient = torch.randn(weights.shape, generator=generator)
        weights.grad = gradient.clone()
        optimizer.step()
        gradient = gradient.double().numpy()
        mean = 0.95 * mean + 0.05 * gradient
        direction = orthogonalised(torch.tensor(0.05 * gradient + 0.95 * mean).float().reshape(8, 27)).double().numpy()
        before = before * (1 - RATE * DECAY) - RATE * 0.2 * math.sqrt(27) * direction.reshape(weights.shape)
        np.testing.assert_allclose(weights.detach().numpy(), before, atol=2e-4 * RATE + 1e-6, rtol=1e-3)


def test_steps_are_as_large_as_those_of_adamw():
    """So that one learning rate serves both: root mean square of a step about 0.2 rates."""
    model = network()
    before = model[0].weight.detach().clone()
    take(model, Muon(model, RATE, 0.0), 1)
    size = float((model[0].weight.detach() - before).square().mean().sqrt())
    assert 0.15 * RATE < size < 0.25 * RATE


def test_the_rest_takes_what_adamw_takes():
    """Without convolutions to move, both optimisers are one."""
    models = [network() for _ in range(2)]
    for model in models:
        model[0].weight.requires_grad_(False)
    for model, kind in zip(models, ("muon", "adamw"), strict=True):
        take(model, OPTIMIZERS[kind](model, RATE, DECAY), 5)
    for ours, theirs in zip(models[0].parameters(), models[1].parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=0)


def test_settings_know_all_of_them():
    assert tuple(OPTIMIZERS) == OPTIMIZER_KINDS


def test_one_of_ones_own_can_be_chosen(monkeypatch):
    with pytest.raises(InputError, match="^trainer.optimizer: expected one of muon, adamw, got 'mine'"):
        TrainerSettings(optimizer="mine").check()
    monkeypatch.setitem(OPTIMIZERS, "mine", Muon)
    TrainerSettings(optimizer="mine").check()


@pytest.mark.parametrize("kind", OPTIMIZERS)
def test_a_saved_state_goes_on_to_the_bit(kind, tmp_path):
    model = network()
    optimizer = OPTIMIZERS[kind](model, RATE, DECAY)
    take(model, optimizer, 3)
    torch.save(optimizer.state_dict(), tmp_path / "state.pt")
    other = copy.deepcopy(model)
    resumed = OPTIMIZERS[kind](other, RATE, DECAY)
    resumed.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    take(model, optimizer, 3, seed=2)
    take(other, resumed, 3, seed=2)
    for ours, theirs in zip(model.parameters(), other.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=0)


def test_a_closure_is_called_once_and_with_gradients():
    model, calls = network(), []
    optimizer = Muon(model, RATE, DECAY)

    def closure():
        calls.append(1)
        loss = model(torch.ones(2, 3, 6, 6)).square().mean()
        loss.backward()
        return loss

    before = model[0].weight.detach().clone()
    assert float(optimizer.step(closure).detach()) > 0 and len(calls) == 1
    assert not torch.equal(before, model[0].weight)


def test_layouts_of_memory_change_nothing():
    models = [network(), network().to(memory_format=torch.channels_last)]
    for model in models:
        take(model, Muon(model, RATE, DECAY), 2)
    torch.testing.assert_close(models[0][0].weight, models[1][0].weight, rtol=1e-3, atol=1e-4)


def test_weights_decay_and_biases_do_not():
    model = network()
    groups = parameter_groups(model.parameters(), DECAY)
    assert sum(len(group["params"]) for group in groups) == len(list(model.parameters()))
    for group in groups:
        for parameter in group["params"]:
            assert (group["weight_decay"] == DECAY) == (parameter.ndim > 1) and group["convolutions"] == (parameter.ndim > 2)
