import joblib
import pytest
import torch
from training_toys import tiny_settings

from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.train import train


@pytest.fixture(autouse=True)
def one_process():
    """Processes would import everything again; and threads that a run asks for are its own."""
    threads = torch.get_num_threads()
    with joblib.parallel_config(backend="threading"):
        yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="session")
def finished(tmp_path_factory, cache):
    """A run of two epochs, never interrupted."""
    settings = tiny_settings(tmp_path_factory.mktemp("runs") / "whole", cache)
    with joblib.parallel_config(backend="threading"):
        return settings, train(settings)


@pytest.fixture
def logged(monkeypatch):
    """What a module logs, by name, without a trainer."""
    values = {}
    monkeypatch.setattr(
        ReconstructionModule, "log", lambda self, name, value, **about: values.__setitem__(name, float(torch.as_tensor(value).detach()))
    )
    return values
