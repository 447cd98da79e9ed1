import math
from dataclasses import asdict, replace

import lightning as L
import pytest
import torch
from torch.nn import functional as F
from training_toys import TRAINER, module_of, pairs, tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.augmentation import augment
from hilbertvae.reconstruction.likelihood import Bernoulli, free_bits, kl_divergence, known_nll
from hilbertvae.reconstruction.settings import AugmentationSettings, ConditionalNetworkSettings, LikelihoodSettings
from hilbertvae.training.reconstruction_module import ReconstructionModule


@pytest.mark.parametrize(("step", "weight"), [(0, 0.0), (1, 1.0), (7, 1.0)])
def test_the_loss_is_equation_6(logged, step, weight):
    """Eight steps in all: the warm-up of a fifth takes one."""
    module = module_of(step).train()
    loss = module.training_step(pairs(), 0)
    torch.manual_seed(hash((0, step, 0)) % 2**63)
    shown, target = augment(*pairs(), module.settings.augmentation, 2)
    found = module.network(shown)
    nll = Bernoulli(module.settings.likelihood)(found.output, target, shown).mean()
    kl = kl_divergence(found.mean, found.std)
    dull = known_nll(found.known, target, shown).mean()
    assert loss.item() == pytest.approx((nll + 0.03 * dull + weight * free_bits(kl, 0.05)).item(), rel=1e-5)
    assert logged["train/known_nll_per_grid"] == pytest.approx(dull.item(), rel=1e-5)
    assert logged["train/nll_per_grid"] == pytest.approx(nll.item(), rel=1e-5)
    assert logged["train/kl_nats"] == pytest.approx(kl.sum(dim=1).mean().item(), rel=1e-4)


def test_kl_is_paid_against_the_learned_prior_at_its_weight(logged):
    network = ConditionalNetworkSettings(stem=2, channels=[4, 8], blocks=[1, 1], latent=3)
    module = module_of(5, network=network, trainer=replace(TRAINER, kl_weight=0.5, free_nats=0.2)).train()
    loss = module.training_step(pairs(), 0)
    torch.manual_seed(hash((0, 5, 0)) % 2**63)
    shown, target = augment(*pairs(), module.settings.augmentation, 2)
    found = module.network(shown, target)
    fit = Bernoulli(module.settings.likelihood)(found.output, target, shown).mean() + 0.03 * known_nll(found.known, target, shown).mean()
    kl = kl_divergence(found.mean, found.std, found.prior)
    assert loss.item() == pytest.approx((fit + 0.5 * free_bits(kl, 0.2)).item(), rel=1e-5)


def test_an_auto_encoder_pays_no_kl(logged):
    settings = tiny_settings("run", "cache")
    module = module_of(5, network=replace(settings.network, variational=False)).train()
    loss = module.training_step(pairs(), 0)
    paid = logged["train/nll_per_grid"] + 0.03 * logged["train/known_nll_per_grid"]
    assert "train/kl_nats" not in logged and loss.item() == pytest.approx(paid)


def test_a_network_that_does_not_say_what_would_be_known_pays_nothing_for_it(logged):
    settings = tiny_settings("run", "cache")
    loss = module_of(5, network=replace(settings.network, variational=False, known=False)).train().training_step(pairs(), 0)
    assert "train/known_nll_per_grid" not in logged and loss.item() == pytest.approx(logged["train/nll_per_grid"])


def test_a_step_draws_from_seed_and_step_alone(logged):
    losses = []
    for seed, step, noise in ((0, 3, 11), (0, 3, 99), (0, 4, 11), (1, 3, 11)):
        module = module_of(step, seed=seed).train()
        torch.manual_seed(noise)  # whatever happened before
        losses.append(module.training_step(pairs(), 0).item())
    assert losses[0] == losses[1] and len(set(losses)) == 3


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_loss_that_is_not_finite_fails(logged, value):
    module = module_of(3).train()
    with torch.no_grad():
        module.network.mean.bias.fill_(value)
    with pytest.raises(FloatingPointError, match="training loss is .* at step 3: lower trainer.learning_rate"):
        module.training_step(pairs(), 0)


@pytest.mark.parametrize("kind", ["bernoulli", "gaussian"])
def test_validation_goes_by_what_was_removed(logged, kind):
    module = module_of(likelihood=LikelihoodSettings(kind=kind)).eval()
    shown, target = pairs()
    module.validation_step((shown, target), 0)
    output = module.network(shown).output
    probability = torch.sigmoid(output.clamp(-8, 8)) if kind == "bernoulli" else (torch.tanh(output) + 1) / 2
    total = count = 0
    for p, s, t in zip(probability.flatten().tolist(), shown.flatten().tolist(), target.flatten().tolist(), strict=True):
        if s == 0 and t != 0:
            p = min(max(p, 1e-4), 1 - 1e-4)
            total, count = total - math.log(p if t > 0 else 1 - p), count + 1
    assert logged["val/gap_nll"] == pytest.approx(total / count, rel=1e-4)


def test_a_step_whose_gradient_is_not_finite_is_skipped_and_counted(logged):
    module = module_of()
    optimizer = module.configure_optimizers()["optimizer"]
    before = [p.detach().clone() for p in module.network.parameters()]
    for broken in (True, False):
        logged.clear()
        F.mse_loss(module.network(pairs()[0]).output, torch.ones(8, 16, 16)).backward()
        if broken:
            module.network.head[-1].weight.grad[0, 0, 0, 0] = math.inf
        module.on_before_optimizer_step(optimizer)
        optimizer.step()
        same = all(torch.equal(p, old) for p, old in zip(module.network.parameters(), before, strict=True))
        assert same == broken
        assert logged["train/skipped_steps"] == broken and ("train/gradient_norm" in logged) != broken


@pytest.mark.parametrize(("says", "gives"), [(True, "no "), (False, "")])
def test_a_network_of_one_s_own_gives_known_if_its_settings_say_so(monkeypatch, says, gives):
    """A map asks for it by the settings: else it would fail after the training, or be without what was learned."""
    module = module_of()
    monkeypatch.setattr(module.settings, "network", replace(module.settings.network, known=says))
    forward, other = module.network.forward, None if says else torch.zeros(8, 16, 16)
    monkeypatch.setattr(module.network, "forward", lambda shown: replace(forward(shown), known=other))
    expected = f"network.known: expected {str(not says).lower()}, since GatedNetwork.forward gives {gives}`known`"
    with pytest.raises(InputError, match=expected):
        module.train().training_step(pairs(), 0)


@pytest.mark.parametrize("kind", ["bernoulli", "gaussian"])
@pytest.mark.parametrize(("change", "expected"), [
    (lambda found: found.output, "to give a Reconstruction, got Tensor"),
    (lambda found: (found.output,), "to give a Reconstruction, got tuple"),
    (lambda found: replace(found, output=found.output.unsqueeze(1)), r"`output` of shape \(8, 16, 16\), .*, got \(8, 1, 16, 16\)"),
    (lambda found: replace(found, output=found.output[:, :-1]), r"`output` of shape \(8, 16, 16\), as the grids', got \(8, 15, 16\)"),
    (lambda found: replace(found, output=None), "`output` of shape .*, got NoneType"),
    (lambda found: replace(found, known=found.known[:, :1]), "`known` of shape .*, got "),
])  # fmt: skip
def test_a_network_of_one_s_own_gives_a_reconstruction_of_the_grids_shape(monkeypatch, logged, kind, change, expected):
    """Else torch says something of its own, or repeats what it has, and the network learns nonsense."""
    module = module_of(likelihood=LikelihoodSettings(kind=kind))
    forward = module.network.forward
    monkeypatch.setattr(module.network, "forward", lambda shown: change(forward(shown)))
    for step in (module.train().training_step, module.eval().validation_step):
        with pytest.raises(InputError, match=f"network: expected GatedNetwork.forward .*{expected}"):
            step(pairs(), 0)


class Broken(ReconstructionModule):
    """Whose gradients of some steps are not finite."""

    def on_before_optimizer_step(self, optimizer):
        if self.global_step in self.at:
            self.network.head[-1].weight.grad.fill_(math.nan)
        super().on_before_optimizer_step(optimizer)


def trained_with(at):
    module = Broken(tiny_settings("run", "cache"))
    module.at = at
    trainer = L.Trainer(max_epochs=1, logger=False, accelerator="cpu", log_every_n_steps=1, enable_progress_bar=False,
                        enable_checkpointing=False, enable_model_summary=False)  # fmt: skip
    trainer.fit(module, torch.utils.data.DataLoader([tuple(part[0] for part in pairs())] * 5, batch_size=1))
    return trainer.callback_metrics


def test_skipped_steps_are_counted_over_an_epoch():
    assert trained_with({1, 3})["train/skipped_steps"] == 2


def test_an_epoch_that_learned_nothing_is_an_error():
    with pytest.raises(FloatingPointError, match="no gradient of the epoch that ended at step 5 is finite"):
        trained_with(range(5))


def test_the_validation_loss_is_that_of_hidden_cells_and_needs_nothing_that_gpus_refuse(logged, monkeypatch):
    """torch refuses `binary_cross_entropy` wherever a GPU computes in bfloat16."""
    module, (shown, target) = module_of().eval(), pairs()
    probability = torch.sigmoid(module.network(shown).output.detach()).double()
    hidden = (shown == 0) & (target != 0)
    expected = F.binary_cross_entropy(probability[hidden].clamp(1e-4, 1 - 1e-4), (target[hidden] > 0).double()).item()
    monkeypatch.setattr(F, "binary_cross_entropy", None)
    module.validation_step((shown, target), 0)
    assert logged["val/gap_nll"] == pytest.approx(expected, rel=1e-5)


def test_the_learning_rate_rises_and_falls_as_a_cosine():
    module = module_of(trainer=replace(TRAINER, epochs=10, steps_per_epoch=10, warmup_share=0.1, learning_rate=2e-3))
    made = module.configure_optimizers()
    optimizer, schedule = made["optimizer"], made["lr_scheduler"]["scheduler"]
    assert made["lr_scheduler"]["interval"] == "step"
    for step in range(100):
        expected = 2e-3 * min(1, (step + 1) / 10) * (0.01 + 0.495 * (1 + math.cos(math.pi * step / 100)))
        assert optimizer.param_groups[0]["lr"] == pytest.approx(expected)
        optimizer.step()
        schedule.step()


def test_hyper_parameters_are_plain():
    module = module_of()
    assert dict(module.hparams)["settings"] == asdict(module.settings)


def test_votes_weigh_cells_in_training_and_not_in_validation(logged):
    settings = tiny_settings("run", "cache")
    module = module_of(likelihood=replace(settings.likelihood, vote_power=0.5), augmentation=AugmentationSettings(False, 0)).train()
    shown, target = pairs()
    votes = torch.randint(8, 100, target.shape, generator=torch.Generator().manual_seed(4)).to(torch.int8) * (target != 0)
    voted = torch.stack([target, votes], dim=1)
    module.training_step((shown, voted), 0)
    torch.manual_seed(hash((0, 0, 0)) % 2**63)
    output = module.network(shown).output
    expected = Bernoulli(module.settings.likelihood)(output, target, shown, votes).mean()
    assert logged["train/nll_per_grid"] == pytest.approx(expected.item(), rel=1e-5)
    module.eval().validation_step((shown, voted), 0)
    found = logged["val/nll_per_grid"], logged["val/gap_nll"]
    module.validation_step((shown, target), 0)
    assert found == (logged["val/nll_per_grid"], logged["val/gap_nll"])
