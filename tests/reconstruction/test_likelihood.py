import math

import numpy as np
import pytest
import torch
from torch.distributions import Normal
from torch.distributions import kl_divergence as torch_kl

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.likelihood import (
    LIKELIHOODS,
    Bernoulli,
    Gaussian,
    active_dimensions,
    free_bits,
    kl_divergence,
    kl_weight,
    known_nll,
)
from hilbertvae.reconstruction.settings import LIKELIHOOD_KINDS, LikelihoodSettings
from toy_rooms import tiny_reconstructor


def random_case(seed=0, shape=(3, 4, 4)):
    generator = torch.Generator().manual_seed(seed)
    output = 3 * torch.randn(shape, generator=generator)
    target = torch.randint(-1, 2, shape, generator=generator).to(torch.int8)
    shown = torch.where(torch.rand(shape, generator=generator) < 0.4, torch.zeros_like(target), target)
    return output, target, shown


@pytest.mark.parametrize("shape", [(3, 4, 4), (2, 3, 3, 3)])
def test_bernoulli_by_an_explicit_loop(shape):
    output, target, shown = random_case(shape=shape)
    found = Bernoulli(LikelihoodSettings(observed_weight=0.2))(output, target, shown)
    for b in range(shape[0]):
        expected = 0.0
        for logit, truth, seen in zip(output[b].flatten().tolist(), target[b].flatten().tolist(), shown[b].flatten().tolist(), strict=True):
            if truth == 0:
                continue  # unknown cells say nothing
            p = 1 / (1 + math.exp(-logit))
            expected -= (0.2 if seen else 1.0) * math.log(p if truth > 0 else 1 - p)
        assert found[b].item() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("shape", [(3, 4, 4), (2, 3, 3, 3)])
def test_gaussian_by_an_explicit_loop(shape):
    output, target, shown = random_case(shape=shape)
    found = Gaussian(LikelihoodSettings())(output, target, shown)
    for b in range(shape[0]):
        expected = sum(
            0.5 * (math.tanh(x) - t) ** 2 for x, t in zip(output[b].flatten().tolist(), target[b].flatten().tolist(), strict=True)
        )
        assert found[b].item() == pytest.approx(expected, rel=1e-5)


def test_gaussian_is_a_log_density_of_unit_variance_but_for_its_constant():
    output, target, shown = random_case()
    density = Normal(torch.tanh(output), 1.0).log_prob(target.float()).flatten(1).sum(dim=1)
    found = Gaussian(LikelihoodSettings(kind="gaussian"))(output, target, shown)
    torch.testing.assert_close(found, -density - 16 * 0.5 * math.log(2 * math.pi))


def test_kernel_values():
    output = torch.tensor([-100.0, -1.5, 0.0, 2.0, 100.0])
    assert Bernoulli.kernel_value(output).tolist() == [-8.0, -1.5, 0.0, 2.0, 8.0]
    assert Gaussian.kernel_value(output).tolist() == pytest.approx([-1.0, math.tanh(-1.5), 0.0, math.tanh(2.0), 1.0])
    assert Bernoulli.kernel_value(output.bfloat16()).dtype == torch.float32
    assert tuple(LIKELIHOODS) == LIKELIHOOD_KINDS


def test_one_of_ones_own_can_be_chosen(monkeypatch):
    with pytest.raises(InputError, match="^likelihood.kind: expected one of bernoulli, gaussian, got 'mine'"):
        LikelihoodSettings(kind="mine")
    monkeypatch.setitem(LIKELIHOODS, "mine", Bernoulli)
    assert LikelihoodSettings(kind="mine").kind == "mine"


def test_kl_is_that_of_torch():
    generator = torch.Generator().manual_seed(0)
    mean, std = torch.randn(5, 7, generator=generator), torch.rand(5, 7, generator=generator) + 0.05
    torch.testing.assert_close(kl_divergence(mean, std), torch_kl(Normal(mean, std), Normal(0.0, 1.0)))
    assert not kl_divergence(torch.zeros(2, 3), torch.ones(2, 3)).any()


def test_free_bits_by_an_explicit_loop():
    kl = torch.tensor([[0.0, 0.2, 3.0], [0.02, 0.4, 1.0]])
    expected = sum(max(0.05, (kl[0, d].item() + kl[1, d].item()) / 2) for d in range(3))
    assert free_bits(kl, 0.05).item() == pytest.approx(expected) == pytest.approx(0.05 + 0.3 + 2.0)
    assert free_bits(kl, 0.0).item() == pytest.approx(kl.mean(dim=0).sum().item())


def test_free_bits_do_not_pull_at_what_is_free():
    kl = torch.tensor([[0.01, 0.5]], requires_grad=True)
    free_bits(kl, 0.05).backward()
    assert kl.grad.tolist() == [[0.0, 1.0]]


def test_active_dimensions_counts_those_that_carry_something():
    assert active_dimensions(torch.tensor([[0.0, 0.03, 1.0], [0.0, 0.0, 1.0]])) == 2
    assert active_dimensions(torch.zeros(4, 9)) == 0


def test_warm_up_is_a_straight_line_to_one():
    assert [kl_weight(step, 4) for step in range(6)] == [0.0, 0.25, 0.5, 0.75, 1.0, 1.0]
    assert kl_weight(0, 0) == 1.0


def test_an_unknown_likelihood_is_named():
    with pytest.raises(InputError, match="likelihood.kind: expected one of bernoulli, gaussian, got 'poisson'"):
        LikelihoodSettings(kind="poisson")


def test_without_the_mask_a_cell_that_nobody_saw_costs_least_at_one_half():
    target, shown = torch.tensor([[0, 1, -1]], dtype=torch.int8), torch.tensor([[0, 0, 0]], dtype=torch.int8)
    unmasked = Bernoulli(LikelihoodSettings(masked=False))

    def cost(first: float) -> float:
        return unmasked(torch.tensor([[first, 0.0, 0.0]]), target, shown).item()

    assert cost(0.0) < min(cost(-0.5), cost(0.5))
    known = Bernoulli(LikelihoodSettings())(torch.tensor([[3.0, 0.0, 0.0]]), target, shown).item()
    np.testing.assert_allclose(cost(0.0) - known, np.log(2), rtol=1e-6)


def test_what_would_be_known_is_asked_where_nothing_is_shown():
    """Cell by cell: a coin flip for each that the input lacks, nothing for those that it has."""
    generator = torch.Generator().manual_seed(4)
    known = torch.randn(2, 4, 4, generator=generator)
    target = torch.randint(-1, 2, (2, 4, 4), generator=generator).to(torch.int8)
    shown = torch.where(torch.rand(2, 4, 4, generator=generator) < 0.5, target, torch.zeros_like(target))
    expected = [0.0, 0.0]
    for b in range(2):
        for i in range(4):
            for j in range(4):
                if shown[b, i, j] == 0:
                    p = 1 / (1 + math.exp(-known[b, i, j]))
                    expected[b] -= math.log(p if target[b, i, j] != 0 else 1 - p)
    assert known_nll(known, target, shown).tolist() == pytest.approx(expected, rel=1e-5)


def test_cells_weigh_as_a_power_of_their_votes_by_an_explicit_loop():
    output, target, shown = random_case()
    votes = torch.randint(1, 120, target.shape, generator=torch.Generator().manual_seed(3)).to(torch.int8)
    found = Bernoulli(LikelihoodSettings(observed_weight=0.2, vote_power=0.5))(output, target, shown, votes)
    cells = [cell for cell in np.ndindex(*target.shape) if target[cell] != 0]
    heard = {cell: math.sqrt(math.expm1(votes[cell].item() / 12)) for cell in cells}
    mean = sum(heard.values()) / len(cells)
    expected = [0.0] * len(found)
    for cell in cells:
        p = 1 / (1 + math.exp(-output[cell].item()))
        nll = -math.log(p if target[cell] > 0 else 1 - p)
        expected[cell[0]] += (0.2 if shown[cell] != 0 else 1.0) * heard[cell] / mean * nll
    assert found.tolist() == pytest.approx(expected, rel=1e-4)


def test_no_power_counts_cells():
    output, target, shown = random_case()
    votes = torch.randint(1, 120, target.shape, generator=torch.Generator().manual_seed(3)).to(torch.int8)
    plain = Bernoulli(LikelihoodSettings())
    torch.testing.assert_close(plain(output, target, shown, votes), plain(output, target, shown))


@pytest.mark.parametrize("power", [-0.1, 1.5, float("nan")])
def test_a_power_that_is_none_is_named(power):
    with pytest.raises(InputError, match=r"likelihood.vote_power: expected a power in \[0, 1\]"):
        LikelihoodSettings(vote_power=power)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e5])
def test_kernel_values_that_no_map_can_keep_are_told_of(monkeypatch, value):
    """By the likelihood that gave them: somebody's own may not clip them."""
    monkeypatch.setattr(LIKELIHOODS["bernoulli"], "kernel_value", staticmethod(lambda output: output.float() * 0 + value))
    with pytest.raises(InputError, match="likelihood.kind=bernoulli: expected finite kernel values of at most 65504, got"):
        tiny_reconstructor().complete(np.zeros((2, 16, 16), np.int8))
