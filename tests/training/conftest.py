import joblib
import pytest
import torch


@pytest.fixture(autouse=True)
def one_process():
    """Processes would import everything again; and threads that a run asks for are its own."""
    threads = torch.get_num_threads()
    with joblib.parallel_config(backend="threading"):
        yield
    torch.set_num_threads(threads)
