"""Every chosen mapper on every test site, and the `Result`s to whoever writes them. Knows no Lightning."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache, reduce

import torch
from joblib import Parallel, delayed
from joblib.parallel import get_active_backend

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.weights import occupied_weight_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import ANEW, calibrated_on
from hilbertvae.scoring.calibration import learn_rank_weights
from hilbertvae.scoring.protocol import alike, evaluate_all
from hilbertvae.scoring.result import Result
from hilbertvae.site import Site
from hilbertvae.training.given_networks import give_networks
from hilbertvae.training.kept_scores import KeptScores, forget_scores
from hilbertvae.training.learned_as import KEY, as_made, learned_as, settings_of
from hilbertvae.training.opened_sites import opened_site
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import check_unseen

Writer = Callable[[Result, Site, dict[str, Mapper]], bool | None]
"""False where a part of what it writes is missing, so that the scores are kept for another try."""


def use_threads(settings: Settings) -> None:
    """`trainer.threads` for all that torch computes in this process."""
    at_first = _threads_at_first()
    torch.set_num_threads(settings.trainer.threads or at_first)


@cache
def _threads_at_first() -> int:
    """As many as torch takes by itself: those of the job before may be others."""
    return torch.get_num_threads()


def score(settings: Settings, mappers: dict[str, Mapper], reconstructor: Reconstructor | None, write: Writer | None) -> None:
    """Score `mappers` by name on the settings' test sites; `write(result, site, mappers)` gets a `Result` for each.

    A scoring that was stopped goes on after the last mapper and gap seed that were done, if nothing that they depend on has changed.
    """
    if not mappers:
        return
    use_threads(settings)
    given = give_networks(settings, mappers, reconstructor)
    _learn_weights_anew(settings, given)
    whole = True
    for reference in settings.data.test:
        site = opened_site(reference, settings)
        if settings.scoring_processes > 1:
            result = _side_by_side(settings, given, reference)
        else:
            result = evaluate_all(given, site, settings.evaluation, print, KeptScores(settings, reference))
        written = write(result, site, given) if write else None
        whole = whole and not result.failed and written is not False
    if whole:  # else what did not fail need not be scored again
        forget_scores(settings.output)


def _learn_weights_anew(settings: Settings, mappers: dict[str, Mapper]) -> None:
    """Other `rank` weights for maps whose grids lie otherwise, or answer in another number, or whose evidence has other voxels, than the
    network's weights were learned for."""
    learned: dict = {}
    for mapper in mappers.values():
        network = getattr(mapper, "reconstructor", None)
        if not network or not network.map_weights or mapper.weights == "unit":
            continue
        known = {len(weights["unseen"]) - 1 for weights in network.map_weights.values()}
        if mapper.inner_radius_m is None and known == {mapper.neighbours} and mapper.resolution_m in (None, network.resolution_m):
            continue
        chosen = {name: getattr(mapper, name) for name in ("neighbours", "inner_radius_m", "resolution_m", "flips", "device")}
        key = (id(network), *chosen.values())
        if key not in learned:
            _check_calibration_sites(settings, network.card)
            anew = HilbertMap(replace(network, map_weights={}), **chosen)
            references = settings.calibration_sites()
            sites = [opened_site(reference, settings) for reference in references]
            counted = {"occupied_weight": occupied_weight_of(network.map_weights)}  # as its own were: rows differ by what was asked
            weights = learn_rank_weights(anew, sites, **settings.calibration() | counted)
            card = {**network.card, KEY: learned_as(settings), "calibrated_on": references, ANEW: True}
            learned[key] = replace(network, map_weights=weights, card=card)
        mapper.set_params(reconstructor=learned[key])


def _check_calibration_sites(settings: Settings, card: dict) -> None:
    """An `InputError` for sites that the network was trained on, where it is surer than elsewhere (METHOD 5); a warning for others than
    those on which its own weights were learned, since rows of both kinds compare sites, too."""
    key, sites = "data.calibrate" if settings.data.calibrate else "data.validate", settings.calibration_sites()
    check_unseen(sites, card, key, "the network whose weights are learned anew")
    before = calibrated_on(card) or sites
    source = settings.source()
    source_before = settings_of(card, settings.dimension).source() if KEY in card else source
    if (then := as_made(before, source_before)) != (now := as_made(sites, source)):
        otherwise = ", made otherwise" if then.keys() == now.keys() else ""
        learned = f"the network's own were learned on {', '.join(before)}{otherwise}"
        text = f"{key}: weights are learned anew on {', '.join(sites)}, {learned}; results of both differ by that"
        warnings.warn(text, stacklevel=2)


def _side_by_side(settings: Settings, mappers: dict[str, Mapper], reference: str) -> Result:
    """`evaluate_all` with some mappers and seeds at a time. A site is opened once in each process: to send it would take as long."""
    groups, seeds = alike(mappers), settings.evaluation.gap_seeds
    # In a worker of a multirun joblib would take threads, which fit the same mapper to several seeds' points at once.
    backend = "loky" if get_active_backend()[0].nesting_level else None
    parts = Parallel(n_jobs=settings.scoring_processes, backend=backend)(
        delayed(_evaluate_some)(settings, reference, group, seed) for group in groups for seed in seeds
    )
    by_group = [reduce(Result.followed_by, parts[start : start + len(seeds)]) for start in range(0, len(parts), len(seeds))]
    every, *others = by_group
    for result in others:
        every.add(result)
        every.gaps = every.gaps if len(every.gaps) == len(seeds) else result.gaps
    return every


def _evaluate_some(settings: Settings, reference: str, mappers: dict[str, Mapper], seed: int) -> Result:
    use_threads(settings)
    protocol = replace(settings.evaluation, gap_seeds=[seed])
    return evaluate_all(mappers, opened_site(reference, settings), protocol, print, KeptScores(settings, reference))
