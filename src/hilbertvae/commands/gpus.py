"""GPUs dealt out among jobs that run at a time on one machine."""

from __future__ import annotations

import os

import torch


def give_gpus(job: int, wanted: int) -> None:
    """Let this process see `wanted` of the machine's GPUs, others than the jobs before and after it; with as many or fewer, all.

    For launchers that don't deal themselves: SLURM and Ray do. To be called before anything is put on a GPU; a process that is reused
    for another job keeps what it was given, since CUDA looks only once.
    """
    if "HILBERTVAE_GPUS_GIVEN" in os.environ or torch.cuda.is_initialized():
        return
    seen = os.environ.get("CUDA_VISIBLE_DEVICES")
    every = seen.split(",") if seen else [str(number) for number in range(torch.cuda.device_count())]
    if len(every) <= wanted:
        return
    given = [every[(job * wanted + k) % len(every)] for k in range(wanted)]
    os.environ["CUDA_VISIBLE_DEVICES"] = ",".join(given)
    os.environ["HILBERTVAE_GPUS_GIVEN"] = "1"
