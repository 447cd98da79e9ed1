"""What a run that trains nothing says in `result.json`: of the network that it scores what the network says, not what nobody read."""

from __future__ import annotations

from dataclasses import asdict

from hilbertvae.commands.overrides import OF_A_SCORING_TOO, OF_A_TRAINING, OF_A_TRAINING_ALONE
from hilbertvae.mappers.weights import occupied_weight_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.training.learned_as import KEY
from hilbertvae.training.settings import Settings


def config_without_training(settings: Settings) -> dict:
    """The settings as plain values, without those that only a training reads."""
    config = asdict(settings)
    for part in (key.rstrip(".") for key in OF_A_TRAINING):
        config[part] = {key: value for key, value in config[part].items() if f"{part}.{key}" in OF_A_SCORING_TOO}
        if not config[part]:
            del config[part]
    for key in OF_A_TRAINING_ALONE:
        *part, name = key.split(".")
        (config[part[0]] if part else config).pop(name)
    return config


def of_network(network: Reconstructor) -> dict:
    """The settings that lie in the network's own file."""
    parts = {"network": network.network_settings, "grid": network.grid, "likelihood": network.likelihood}
    found = {name: asdict(part) for name, part in parts.items()}
    weights = network.map_weights
    return found | ({"calibration_occupied_weight": occupied_weight_of(weights)} if weights else {})


def of_named(config: dict, networks: dict[str, Reconstructor]) -> dict:
    """The settings of a run whose mappers name several networks, by mapper, or none: those of a network of the run were read by nobody."""
    config = {key: value for key, value in config.items() if key not in ("network", "likelihood", "calibration_occupied_weight")}
    return config | ({"networks": {name: of_network(network) for name, network in networks.items()}} if networks else {})


def seeds_of(settings: Settings, network: Reconstructor | None, trains: bool) -> dict:
    """What was seeded by what: of a network that was given, its training and its map's weights as its card says; None where it does not. Of
    several networks, and of none, those of the gaps alone."""
    seeds = {"training": settings.seed, "gaps": settings.evaluation.gap_seeds, "calibration": settings.calibration_seeds}
    if network is None:
        return seeds if trains else {"gaps": seeds["gaps"]}
    seeds["training"] = network.card.get("seed", settings.seed)
    if network.map_weights:
        seeds["calibration"] = network.card.get(KEY, {}).get("calibration_seeds")
    return seeds
