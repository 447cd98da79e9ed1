"""Which network each mapper gets: that of the run, one that it names, or none."""

from __future__ import annotations

import copy
import warnings

from hilbertvae.checks import InputError, named
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.adaptation import check_adaptable
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import calibrated_on
from hilbertvae.reports.mapper_names import without_sampling
from hilbertvae.training.devices import filling_device
from hilbertvae.training.settings import TRAINED, Settings
from hilbertvae.training.site_roles import check_unseen, place

NOT_THERE = object()


def needs_training(mappers: dict[str, Mapper]) -> bool:
    """Whether any mapper takes the network of the run."""
    return any(mapper.get_params(deep=False).get("reconstructor") == TRAINED for mapper in mappers.values())


def load_named(settings: Settings, mappers: dict[str, Mapper], reconstructor: Reconstructor | None = None) -> dict[str, Mapper]:
    """Copies of the mappers with the networks that they name, each file read once; `reconstructor` is the run's, if that is there already.

    Raises `InputError`, before anything is trained, for what would be refused after it: networks that are missing, damaged, of another
    dimension or trained on a test site, maps that can't have their boxes, and two of one name.
    """
    loaded, given, names = {}, {}, set()
    for name, mapper in mappers.items():
        mapper = copy.copy(mapper)  # sklearn's clone would copy networks
        if isinstance(mapper, HilbertMap):
            if isinstance(path := mapper.reconstructor, str) and path != TRAINED:
                with named(f"mapper.{name}.reconstructor"):
                    loaded[path] = loaded.get(path) or Reconstructor.load(path)
                mapper.set_params(reconstructor=loaded[path])
            of_run = mapper.reconstructor == TRAINED
            network = reconstructor if of_run else mapper.reconstructor
            if network:
                _check_network(settings, name, mapper, network)
            if mapper.adapt_steps and mapper.reconstructor is not None:
                with named(f"mapper.{name}"):
                    check_adaptable((network or settings).likelihood, network.network_settings if network else settings.network)
            grid = mapper.grid or (network or settings).grid
            if mapper.inner_radius_m is not None and mapper.inner_radius_m > grid.cluster_diameter_m / 2:
                most = f"at most half of its boxes' {grid.cluster_diameter_m:g} m"
                raise InputError(f"mapper.{name}.inner_radius_m: expected {most}, got {mapper.inner_radius_m:g}")
            score_name = _score_name(name, network.network_settings if network else settings.network) if of_run else name
        else:
            score_name = name
        if score_name in names:
            raise InputError(f"mapper.{name}: expected one mapper of that name; a network without sampling gives a `cvae-...` row this one")
        names.add(score_name)
        given[name] = mapper
    return given


def give_networks(settings: Settings, mappers: dict[str, Mapper], reconstructor: Reconstructor | None) -> dict[str, Mapper]:
    """Copies of the mappers with their networks, and maps of raw grids with the grids of the run, under the names of their scores: who
    trains several networks in turn gives each run the same mappers.

    A network without sampling is no CVAE: what is configured as `cvae-...` for the network of the run is scored as `cae-...`.
    """
    given = {}
    for name, mapper in load_named(settings, mappers, reconstructor).items():
        if isinstance(mapper, HilbertMap):
            if mapper.reconstructor == TRAINED:
                if reconstructor is None:
                    raise InputError(f"mapper.{name}: expected a trained network or `checkpoint`, got neither")
                mapper.set_params(reconstructor=reconstructor)
                name = _score_name(name, reconstructor.network_settings)
            elif mapper.reconstructor is None and mapper.grid is None:
                of = reconstructor or settings
                mapper.set_params(grid=of.grid, resolution_m=of.resolution_m if mapper.resolution_m is None else mapper.resolution_m)
            if mapper.device == "auto":
                mapper.set_params(device=filling_device(settings))
        elif mapper.get_params(deep=False).get("resolution_m", NOT_THERE) is None:
            mapper.set_params(resolution_m=settings.resolution_m)
        given[name] = mapper
    return given


def _score_name(name: str, network: object) -> str:
    """What a map of the run's network is scored as."""
    return name if getattr(network, "variational", False) else without_sampling(name)


def _check_network(settings: Settings, name: str, mapper: HilbertMap, network: Reconstructor) -> None:
    """An `InputError` for a network that is not for this run's sites, or knows them."""
    if network.dimension != settings.dimension:
        raise InputError(f"mapper.{name}.reconstructor: expected a network for {settings.dimension}D, got one for {network.dimension}D")
    if mapper.resolution_m is None and network.resolution_m != settings.resolution_m:
        wanted = f"{network.resolution_m:g}, as the network of mapper.{name} was trained with"
        raise InputError(f"resolution_m: expected {wanted}, got {settings.resolution_m:g}")
    check_unseen(settings.data.test, network.card, "data.test", f"the network of mapper.{name}")
    taught = set(map(place, calibrated_on(network.card)))
    if known := [site for site in settings.data.test if place(site) in taught]:
        flattered = f"mapper.{name} learned its map's weights on {', '.join(known)}, and its scores there are better than elsewhere"
        warnings.warn(f"data.test: {flattered}", stacklevel=2)
