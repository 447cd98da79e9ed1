"""Scores don't depend on which processes compute them, and a job leaves nothing to the next one."""

from dataclasses import replace

import pytest
import torch
from joblib import Parallel, delayed
from training_toys import TRAINER, scores_of_late, tiny_settings

from hilbertvae.scoring.protocol import Protocol
from hilbertvae.training.scoring import use_threads
from hilbertvae.training.settings import DataSettings


@pytest.fixture
def settings(tmp_path):
    data = DataSettings(test=["simulated:900002"], simulated_extent_m=[12, 16], simulated_scans=20)
    return tiny_settings(tmp_path / "run", tmp_path / "cache", data, evaluation=Protocol(gap_seeds=[0, 1, 2], occlusion=False))


def test_processes_within_a_worker_of_a_multirun_score_as_none_do(settings, tmp_path):
    job = replace(settings, output=str(tmp_path / "other"), scoring_processes=2)
    assert Parallel(n_jobs=2, backend="loky")([delayed(scores_of_late)(job)]) == [scores_of_late(settings)]


def test_threads_of_one_job_are_not_those_of_the_next(settings):
    use_threads(replace(settings, trainer=replace(TRAINER, threads=0)))
    at_first = torch.get_num_threads()
    use_threads(replace(settings, trainer=replace(TRAINER, threads=at_first + 1)))
    assert torch.get_num_threads() == at_first + 1
    use_threads(replace(settings, trainer=replace(TRAINER, threads=0)))
    assert torch.get_num_threads() == at_first
