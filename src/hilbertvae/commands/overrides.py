"""What is typed on the command line of `hilbertvae-train`, where nothing would come of it."""

from __future__ import annotations

from collections.abc import Iterator

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.settings import COUNTED
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.training.settings import TRAINED, Settings

OF_A_NETWORK = ("network", "grid", "start", "likelihood", "calibration_occupied_weight")
"""Settings that lie in the file of a network."""
OF_RAW_GRIDS = ("grid", "start")
"""Those that maps of raw grids take from the run, where it has no network, or several."""
OF_ITS_WEIGHTS = ("validation_gap_m", "calibration_seeds", "calibration_given", "data.calibrate")
"""Settings of how a map's weights are learned, which lie there too and count for maps that need others."""
LEARN_ANEW = {"neighbours", "inner_radius_m", "resolution_m"}
"""Settings of a map that has weights of its own learned, if they are not as its network's were (`training/scoring.py`)."""
OF_A_TRAINING, OF_A_SCORING_TOO = ("augmentation.", "clustering.", "trainer."), ("trainer.threads", "trainer.accelerator")
"""Settings of how a network is trained, and those of them that say how maps are made, too."""
OF_A_TRAINING_ALONE = ("trained", "data.train", "data.simulated", "data.simulated_first", "data.simulated_clusterings")
"""More of them. `data.validate` may have to be named where a network is scored on the default one; sweeps bring a `seed` with them."""
OF_ANOTHER_SPACE = {
    2: (("data.street",), "simulated sites are buildings"),
    3: (("data.simulated_scans", "data.simulated_extent_m", "data.simulated_variety"), "simulated sites are what `data.street` says"),
}
"""By `dimension` the settings of sites that aren't drawn in it, and why."""


def refuse_ignored(settings: Settings, overrides: list[str]) -> None:
    """An `InputError` for a setting that nothing would come of: of sites as they are in the other dimension, or as none of the run's is,
    or, typed beside a `checkpoint`, of what that network brings with it. So it is where mappers name the networks, and none is trained."""
    theirs, why = OF_ANOTHER_SPACE[settings.dimension]
    for key in _typed_keys(overrides):
        if key.startswith(theirs):
            raise InputError(f"{key}: expected none with dimension={settings.dimension}, where {why}")
    named = named_networks(settings)
    own = f"checkpoint={settings.checkpoint}" if settings.checkpoint else next((f"{key}={path}" for key, path in named.items()), "")
    training = not settings.trains_none()
    _refuse_of_no_site(settings, overrides, training)
    if training:
        return
    several = not settings.checkpoint and len({*named.values()}) > 1  # whose boxes maps of raw grids can't all have
    for key in _typed_keys(overrides):
        if several and key.partition(".")[0] in OF_RAW_GRIDS:
            continue
        if key.partition(".")[0] in OF_A_NETWORK:
            at_hand = "; `mapper.<name>.inner_radius_m` is a map's own" if key in ("start", "grid") or key.startswith("grid.") else ""
            raise InputError(f"{key}: expected none beside {own}, which has its own{at_hand}")
        if (key.startswith(OF_A_TRAINING) and key not in OF_A_SCORING_TOO) or key in OF_A_TRAINING_ALONE:
            raise InputError(f"{key}: expected none beside {own}, which was trained before")
        if key in OF_ITS_WEIGHTS and not any(map(learns_weights, settings.mapper.values())):
            anew = "they are learned anew for maps with `neighbours`, `inner_radius_m` or `resolution_m` of their own"
            raise InputError(f"{key}: expected none beside {own}, which has its map's weights; {anew}")


def _refuse_of_no_site(settings: Settings, overrides: list[str], training: bool) -> None:
    """An `InputError` for a setting of sites of a kind that the run has none of."""
    data, absent = settings.data, []
    if training and not data.train:
        absent.append((("clustering.clusterings",), "without sites in data.train; simulated ones have data.simulated_clusterings"))
    if training and not data.simulated:
        absent.append((("data.simulated_first", "data.simulated_clusterings"), "with data.simulated=0"))
    if not any(map(is_scan_path, (*data.train, data.validate, *data.calibrate, *data.test))):
        absent.append((("data.reading",), "without a site at a path"))
    for key in _typed_keys(overrides):
        if why := next((why for theirs, why in absent if key.startswith(theirs)), None):
            raise InputError(f"{key}: expected none {why}")


def refuse_of_one_name(overrides: list[str], config_name: str = "config") -> None:
    """An `InputError` for mappers that would be one row: several of the files chosen, typed or by an experiment, write a name, as `hm` and
    `hm-3d`. One may well extend another, by its own defaults. config_name: of the primary configuration."""
    loader = GlobalHydra.instance().config_loader()
    listed = loader.compute_defaults_list(config_name, overrides, RunMode.RUN).defaults
    parents = {one.config_path: one.parent or "" for one in listed if (one.config_path or "").startswith("mapper/")}
    named: dict[str, str] = {}
    for path in parents:
        chosen = path
        while parents[chosen] in parents and parents[chosen] != chosen:
            chosen = parents[chosen]
        option = chosen.removeprefix("mapper/")
        found = loader.repository.load_config(path)  # type: ignore[attr-defined] (of Hydra's only loader)
        for name in found.config if found else []:
            if name != "defaults" and (other := named.setdefault(name, option)) != option:
                raise InputError(f"mapper: expected mappers of different names, got {other} and {option}, both called {name}")


def named_networks(settings: Settings) -> dict[str, str]:
    """The networks that mappers name instead of taking the run's, by key."""
    named = {f"mapper.{name}.reconstructor": one.get("reconstructor") for name, one in settings.mapper.items() if isinstance(one, dict)}
    return {key: name for key, name in named.items() if isinstance(name, str) and name != TRAINED}


def mapper_of(key: str) -> str:
    """The name of the mapper whose network `named_networks` has by this key."""
    return key.removeprefix("mapper.").removesuffix(".reconstructor")


def _typed_keys(overrides: list[str]) -> Iterator[str]:
    """The settings that these words change, also those within `{...}`."""

    def inner(key: str, value: object) -> Iterator[str]:
        if isinstance(value, dict) and value:
            for name, part in value.items():
                yield from inner(f"{key}.{name}", part)
        else:
            yield key

    for word in OverridesParser.create().parse_overrides(overrides):
        yield from inner(word.key_or_group, None if word.is_sweep_override() else word.value())


def learns_weights(mapper: dict | None) -> bool:
    """Whether a configured map has a network, and boxes that lie or answer otherwise than those its weights were learned for."""
    return bool(mapper and mapper.get("reconstructor") and mapper.get("weights") != "unit" and LEARN_ANEW & {*mapper})


def _refuse_without_network(settings: Settings, overrides: list[str]) -> None:
    """An `InputError` for a typed setting of networks, or of a training, in a run whose mappers have none."""
    if settings.task != "maps" or settings.checkpoint or not settings.mapper:
        return
    if any(isinstance(one, dict) and one.get("reconstructor") for one in settings.mapper.values()):
        return
    for key in _typed_keys(overrides):
        of_network = key.partition(".")[0] in OF_A_NETWORK and key.partition(".")[0] not in OF_RAW_GRIDS
        of_weights = key in OF_ITS_WEIGHTS or key == "flips"
        if of_network or of_weights or (key.startswith(OF_A_TRAINING) and key not in OF_A_SCORING_TOO) or key in OF_A_TRAINING_ALONE:
            raise InputError(f"{key}: expected none where no mapper has a network")


def refuse_idle(settings: Settings, overrides: list[str]) -> None:
    """An `InputError` for a typed setting of a training that another one makes idle. Not for a multirun, where one of its jobs may use what
    others don't."""
    _refuse_without_network(settings, overrides)
    network, kind = settings.network, settings.likelihood.kind
    shown = getattr(network, "encoding", None)
    idle = (
        (("likelihood.vote_power", "likelihood.observed_weight", "likelihood.masked"), kind == "gaussian",
         "likelihood.kind=gaussian, to which all cells count alike"),
        (("trainer.kl_weight", "trainer.free_nats", "trainer.kl_warmup_share"), getattr(network, "variational", True) is False,
         "network.variational=false, which pays no KL"),
        (("likelihood.known_weight",), not getattr(network, "known", False),
         "network.known=false" if hasattr(network, "known") else f"network.kind={network.kind}, which does not say what would be known"),
        (("augmentation.count_factor",), shown not in COUNTED, f"network.encoding={shown}, which shows no counts"),
    )  # fmt: skip
    for key in _typed_keys(overrides):
        if why := next((why for theirs, holds, why in idle if holds and key in theirs), None):
            raise InputError(f"{key}: expected none with {why}")
