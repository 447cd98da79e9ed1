"""Networks of a configuration's levels and an eighth of its width, and few random features: the tests see that it runs, not how well it
would learn."""

from pathlib import Path

from hilbertvae.training.settings import Settings

RANDOM_FEATURES = ("hm-fourier", "hm-nystroem")


def narrowed(settings: Settings) -> Settings:
    """These settings with a narrow network: as many levels and the same stem, grids of at most 32 cells for the paper's networks, whose
    dense layers cost most; and with few random features."""
    network = settings.network
    network.channels = [max(8, width // 8) for width in network.channels]
    if hasattr(network, "kernels"):
        network.kernels = [3] * len(network.kernels)
        settings.grid.cells = min(32, settings.grid.cells)
    for name in settings.mapper.keys() & RANDOM_FEATURES:
        settings.mapper[name]["components"] = 64
    settings.check()
    return settings


def shared_grids(tmp_path: Path) -> Path:
    """A cache of grids for all processes of a test session, in the folder that pytest numbered for it."""
    return next((folder for folder in tmp_path.parents if folder.name.startswith("pytest-")), tmp_path.parent) / "grids"
