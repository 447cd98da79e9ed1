"""`python -m hilbertvae.commands.ship`: a trained network becomes one of those that come with the package, and gets its card.

For those who publish the package: it writes into the package's own folder."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hilbertvae.checks import InputError, check_seeds, named
from hilbertvae.cloud import READINGS
from hilbertvae.files import atomic
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.weights import check_occupied_weight, occupied_weight_of
from hilbertvae.reconstruction.added_training import with_training_of
from hilbertvae.reconstruction.mean_weights import mean_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path
from hilbertvae.reconstruction.training_card import calibrated_on
from hilbertvae.reports.card import card_text
from hilbertvae.scoring.calibration import learn_rank_weights
from hilbertvae.scoring.protocol_settings import GIVEN, check_given
from hilbertvae.simulate.building_variety import check_variety
from hilbertvae.site import open_site
from hilbertvae.training.data_settings import DataSettings
from hilbertvae.training.learned_as import KEY, learned_as, settings_of
from hilbertvae.training.site_roles import check_unseen


def ship(
    checkpoint: str | Path,
    name: str,
    rotation: str | None = None,
    interpolated: bool | str = False,
    mean: bool = False,
    plus: Sequence[tuple[str, str]] = (),
    calibrate: Sequence[str] = (),
    occupied_weight: float | None = None,
    calibration_seeds: Sequence[int] = (),
    calibration_given: str | None = None,
    calibration_variety: str | None = None,
) -> Path:
    """Pack the network of `checkpoint`, learn its map's weights with it as packed, and write it where `load_mapper(name)` looks.

    rotation: of the frames of its maps (`FrameSettings`), if they shall be others than those of its training. interpolated: whether they
    are read between cells (`GridSettings`), whatever its training had. mean: take the mean of its weights and those of the network that is
    shipped as `name` now, from which it was trained on. plus: pairs of networks, before and after trainings; the difference of their
    weights is added to its own. calibrate: the sites that the map's weights are learned on, if not those of its training.
    occupied_weight: what an occupied point counts for in the weights for points, which says where the cuts lie between precision and
    recall; as in those that the checkpoint has, unless given. calibration_seeds: the gap seeds that they are learned with, of several
    sites fewer than of one. calibration_given: what maps are given where they are learned, `scans`, `map` or `fine-map` (`Protocol.given`).
    calibration_variety: of simulated sites among them. Else these are made, and gaps cut, as in its training, if its card says how, or by
    default."""
    if occupied_weight is not None:
        check_occupied_weight(occupied_weight, "--occupied-weight")
    if calibration_seeds:
        check_seeds(list(calibration_seeds), "--calibration-seeds")
    trained = Reconstructor.load(checkpoint)
    counted = {"occupied_weight": occupied_weight or occupied_weight_of(trained.map_weights)}
    if mean:
        trained = mean_of(Reconstructor.load(name), trained)
    for pair in plus:
        trained = with_training_of(trained, *map(Reconstructor.load, pair))
    if rotation:
        trained = replace(trained, grid=replace(trained.grid, frame=replace(trained.grid.frame, rotation=rotation)))
    if interpolated:
        trained = replace(trained, grid=replace(trained.grid, interpolated=interpolated))
    known, how = settings_of(trained.card, trained.dimension), "as in its training" if KEY in trained.card else "by defaults"
    others: dict = {"calibration_seeds": list(calibration_seeds)} if calibration_seeds else {}
    if calibration_given:
        check_given(calibration_given, "--calibration-given")
        others["calibration_given"] = calibration_given
    if calibration_variety:
        others["data"] = _of_variety(known.data, trained.dimension, calibration_variety)
    if others:
        known = replace(known, **others)
        trained = replace(trained, card={**trained.card, KEY: learned_as(known)})
    with tempfile.TemporaryDirectory() as folder:
        packed = Reconstructor.load(replace(trained, map_weights={}).save(Path(folder) / "packed.safetensors", packed=True))
    references = list(calibrate) or calibrated_on(trained.card)
    check_unseen(references, trained.card, "--calibrate", "the network")
    print(f"{name}: its map's weights are learned on {', '.join(references)}, {how}")
    sites = [open_site(reference, trained.resolution_m, known.source()) for reference in references]
    mapper = HilbertMap(packed)
    packed.map_weights = learn_rank_weights(mapper, sites, **known.calibration() | counted)
    packed.card = {**trained.card, "flips": mapper.flips_, "calibrated_on": references}
    return packed.save(checkpoint_path(name), packed=True)


def _of_variety(data: DataSettings, dimension: int, variety: str) -> DataSettings:
    """`data` with simulated sites of a variety."""
    if dimension == 2:
        check_variety(variety, "--calibration-variety")
        return replace(data, simulated_variety=variety)
    with named("--calibration-variety"):
        return replace(data, street=replace(data.street, variety=variety))


def write_card(name: str, results: list[Path]) -> Path:
    """The card of the network shipped as `name`, beside it."""
    weights = checkpoint_path(name)
    text = card_text(name, weights, sorted(results))
    with atomic(weights.with_suffix(".md")) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return weights.with_suffix(".md")


def main(words: list[str] | None = None) -> int:
    """Entry point; the exit code, 2 for what can't be shipped."""
    parser = argparse.ArgumentParser(prog="python -m hilbertvae.commands.ship", description=__doc__.split(": ", 1)[1])
    parser.add_argument("name", choices=SHIPPED, help="what `load_mapper` shall know it as")
    parser.add_argument("--checkpoint", help="model.safetensors of a training, or a name; without it the card alone is written anew")
    parser.add_argument("--rotation", help="how boxes of its maps are turned (`grid.frame.rotation`), unless as in its training")
    parser.add_argument(
        "--interpolated", nargs="?", const=True, default=False, choices=READINGS,
        help="its maps are read between cells (`grid.interpolated`), or those for one reading alone",
    )  # fmt: skip
    parser.add_argument("--mean", action="store_true", help="the mean of its weights and those of the network it was trained on from, NAME")
    parser.add_argument(
        "--plus", nargs=2, action="append", default=[], metavar=("BEFORE", "AFTER"),
        help="two networks: what trainings made of the first until it was the second is added to its weights; may be given again",
    )  # fmt: skip
    parser.add_argument("--calibrate", nargs="+", default=[], help="sites that its map's weights are learned on, if not as in its training")
    parser.add_argument(
        "--occupied-weight", type=float, help="what an occupied point counts for in weights for points, if not as in the checkpoint's own"
    )
    parser.add_argument(
        "--calibration-seeds", nargs="+", type=int, default=[], help="gap seeds that they are learned with, if not as in its training"
    )
    parser.add_argument(
        "--calibration-given", choices=GIVEN, help="what maps are given where those weights are learned, if not as in its training"
    )
    parser.add_argument("--calibration-variety", help="of simulated sites that they are learned on, if not as in its training")
    parser.add_argument("--results", type=Path, nargs="*", default=[], help="result.json files that scored it, for its card")
    given = vars(parser.parse_args(words))
    results = given.pop("results")
    try:
        if given["checkpoint"]:
            print(ship(**given))
        print(write_card(given["name"], results))
    except (InputError, OSError) as error:
        print(f"hilbertvae.commands.ship: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
