"""Networks of a configuration's levels and an eighth of its width, and few random features: the tests see that it runs, not how well it
would learn."""

from pathlib import Path

from hydra import compose, initialize_config_dir

from hilbertvae.commands.configuration import CONF

RANDOM_FEATURES = ("hm-fourier", "hm-nystroem")
FEW = ("cvae-hm-quick", "cae-hm-quick")
"""Cases of a table that stand for all where the command itself is tried."""


def narrowed(*overrides: str) -> list[str]:
    """These overrides with those that make their network narrow: as many levels and the same stem, grids of at most 32 cells for
    the paper's networks, whose dense layers cost most; and random features few."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("config", overrides=list(overrides))
    network = config.network
    small = [f"network.channels={[max(8, width // 8) for width in network.channels]}"]
    if "kernels" in network:
        small += [f"network.kernels={[3] * len(network.kernels)}", f"grid.cells={min(32, config.grid.cells)}"]
    few = [f"++mapper.{name}.components=64" for name in RANDOM_FEATURES if name in config.mapper]
    return [*overrides, *small, *few]


def shared_grids(tmp_path: Path) -> Path:
    """A cache of grids for all processes of a test session, in the folder that pytest numbered for it."""
    return next((folder for folder in tmp_path.parents if folder.name.startswith("pytest-")), tmp_path.parent) / "grids"
