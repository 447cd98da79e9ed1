"""Samples per second that the default network trains on, and its share of what this machine's convolutions reach at best.

    python benchmarks/training_throughput.py [--quick]

A step is forward, loss, backward and the default optimiser, in bfloat16 autocast, channels_last, batch 64, grids of 64 x 64 cells. Its
operations are counted by torch's own counter (a multiplication and an addition are two). The peak is the best of a few 3 x 3 convolutions
of friendly shape, forward, in the same format and the same run.
"""

from __future__ import annotations

import numpy as np
import torch
from measuring import arguments, report, seconds_of
from torch.utils.flop_counter import FlopCounterMode

from hilbertvae.reconstruction.likelihood import Bernoulli, free_bits, kl_divergence
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.settings import GatedNetworkSettings, LikelihoodSettings
from hilbertvae.training.optimizers import OPTIMIZERS
from hilbertvae.training.trainer_settings import TrainerSettings

CELLS, BATCH = 64, 64
PEAK_SHAPES = ((128, 32), (256, 32), (512, 16), (1024, 8))
"""Channels, and cells a side."""
FORMATS = (("default", True, True), ("contiguous", True, False), ("float32", False, True))
"""Name, whether in bfloat16, whether channels_last."""


def peak(batch: int, shapes, repeats: int) -> tuple[float, str]:
    """The most operations per second of any of the shapes, and which."""
    best, which = 0.0, ""
    for channels, side in shapes:
        convolve = torch.nn.Conv2d(channels, channels, 3, padding=1, bias=False).bfloat16().to(memory_format=torch.channels_last)
        x = torch.randn(batch, channels, side, side).bfloat16().to(memory_format=torch.channels_last)
        operations = 2 * 9 * channels**2 * side**2 * batch
        with torch.inference_mode():
            convolve(x)
            seconds, _ = seconds_of(lambda: convolve(x), repeats)  # noqa: B023 (called at once)
        if operations / seconds > best:
            best, which = operations / seconds, f"{channels} channels, {side} x {side} cells"
    return best, which


class Training:
    """The default network, its optimiser, and one batch: a step costs the same whatever the grids hold."""

    def __init__(self, batch: int, bf16: bool, channels_last: bool):
        torch.manual_seed(0)
        layout = torch.channels_last if channels_last else torch.contiguous_format
        self.network = build_network(GatedNetworkSettings(), 2, CELLS).train().to(memory_format=layout)
        trainer = TrainerSettings()
        self.optimizer = OPTIMIZERS[trainer.optimizer](self.network, trainer.learning_rate, trainer.weight_decay)
        self.likelihood = Bernoulli(LikelihoodSettings())
        self.bf16 = bf16
        draw = np.random.default_rng(0)
        self.target = torch.from_numpy(draw.integers(-1, 2, (batch, CELLS, CELLS)).astype(np.int8))
        self.shown = torch.where(torch.rand(self.target.shape) < 0.2, 0, self.target).to(torch.int8)

    def step(self) -> None:
        """Forward, loss, backward, and the optimiser's step."""
        with torch.autocast("cpu", torch.bfloat16, enabled=self.bf16):
            found = self.network(self.shown)
        kl = kl_divergence(found.mean.float(), found.std.float())
        loss = self.likelihood(found.output, self.target, self.shown).mean() + free_bits(kl, 0.05)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--threads", type=int, default=0, help="of torch; 0 leaves its own choice")
    given = parser.parse_args(words)
    if given.threads:
        torch.set_num_threads(given.threads)
    batch, shapes, repeats = (2, ((64, 16),), 1) if given.quick else (BATCH, PEAK_SHAPES, 10)
    most, which = peak(batch, shapes, repeats)
    rows = [{"what": f"convolution, {which}", "gflop per second": most / 1e9, "share of the peak": 1.0}]
    for name, bf16, channels_last in FORMATS[:1] if given.quick else FORMATS:
        training = Training(batch, bf16, channels_last)
        with FlopCounterMode(display=False) as counter:
            training.step()
        operations = counter.get_total_flops()
        seconds, _ = seconds_of(training.step, repeats)
        rows.append(
            {
                "what": f"training step, {name}",
                "samples per second": batch / seconds,
                "gflop per sample": operations / batch / 1e9,
                "gflop per second": operations / seconds / 1e9,
                "share of the peak": operations / seconds / most,
            }
        )
    weights = sum(p.numel() for p in training.network.parameters())
    facts = {"threads": torch.get_num_threads(), "batch": batch, "cells": CELLS, "weights": weights}
    report("training_throughput", given, rows, [], facts | {"optimizer": TrainerSettings().optimizer})


if __name__ == "__main__":
    main()
