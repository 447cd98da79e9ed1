from dataclasses import replace

import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.mean_weights import mean_of
from toy_rooms import tiny_grid, tiny_reconstructor


@pytest.mark.parametrize("cells", [16, 24])
def test_each_weight_is_the_mean_of_two(cells):
    """Also where boxes have grown."""
    before, after = tiny_reconstructor(seed=1), replace(tiny_reconstructor(seed=2), grid=tiny_grid(cells=cells))
    found = mean_of(before, after)
    old, new = before.network.state_dict(), after.network.state_dict()
    for name, weight in found.network.state_dict().items():
        torch.testing.assert_close(weight, (old[name] + new[name]) / 2)
    assert found.grid == after.grid and found.map_weights == {} and found.card["mean_with_step_before"]
    assert all(torch.equal(weight, tiny_reconstructor(seed=2).network.state_dict()[name]) for name, weight in new.items())


def test_a_network_that_does_not_go_on_from_the_other_is_refused():
    """Its card would not say what half of the weights have seen."""
    before = replace(tiny_reconstructor(), card={"trained_on": ["hall", "simulated:7"]})
    later = {"trained_on": ["attic"], "started_from": {"trained_on": ["simulated:7"], "started_from": before.card}}
    assert mean_of(before, replace(before, card=later)).card == later | {"mean_with_step_before": 2}
    with pytest.raises(InputError, match="checkpoint: expected a network that goes on from the one before it, .* trained on hall, too"):
        mean_of(before, replace(before, card={"trained_on": ["attic"], "started_from": {"trained_on": ["simulated:7"]}}))


@pytest.mark.parametrize("other", [{"latent": 5}, {"channels": [4, 10]}, {"stem": 1}])
def test_another_network_is_refused(other):
    with pytest.raises(InputError, match="checkpoint: expected a network of .*, as the other is, got"):
        mean_of(tiny_reconstructor(), tiny_reconstructor(**other))


def test_cells_of_another_size_and_another_likelihood_are_refused():
    """Their weights are as many and mean something else."""
    made = tiny_reconstructor()
    finer = replace(made, grid=replace(tiny_grid(cells=32), cluster_diameter_m=1.6))
    with pytest.raises(InputError, match="cells of 0.1 m.*cells of 0.05 m"):
        mean_of(made, finer)
    with pytest.raises(InputError, match="bernoulli.*gaussian"):
        mean_of(made, replace(made, likelihood=replace(made.likelihood, kind="gaussian")))


def test_a_latent_of_all_cells_belongs_to_one_size_of_boxes():
    flat = {"skips": False, "bottom": "flat"}
    larger = tiny_reconstructor(**flat)
    larger = replace(larger, grid=tiny_grid(cells=32))
    larger.network.expand = torch.nn.Linear(3, 2 * larger.network.expand.out_features)
    with pytest.raises(InputError, match="16 cells.*32 cells"):
        mean_of(tiny_reconstructor(**flat), larger)
