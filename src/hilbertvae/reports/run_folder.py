"""A run's folder: what lies in it, whether that is of a run that has finished, and what of it is removed before another one."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.files import atomic, hash_of, json_object
from hilbertvae.reports.provenance import provenance
from hilbertvae.reports.result_json import read_result, write_result
from hilbertvae.scoring.result import Result

RUN = "run"
"""In the place of a mapper's name, in `failed`: the run broke, and not one mapper."""

TRAINING = "training.json"
"""What a training begun in a folder is of, by hashes."""

RESULT = "result.json"
"""What a run has scored on a site, or why it broke (METHOD 7: `status`)."""

NETWORK = "model.safetensors"
"""The network of a training that has ended."""

CHECKPOINTS = "checkpoints"
"""The folder, in a run's own, of what a training goes on from."""

TENSORBOARD, PICTURES, SURFACE = "tensorboard", "pictures", "surface.ply"
"""What lies beside a `result.json`."""

UNFINISHED = "unfinished"
"""The folder, in a run's own, of scores that are kept until it has written everything."""

SCORES = "scores.md"
"""The tables of a `result.json`, beside it."""

LOCK = ".lock"
"""What a run holds in its folder while it is at work there."""

OWN_FOLDERS = {CHECKPOINTS, TENSORBOARD, PICTURES, UNFINISHED}
"""Names in a run's folder that no site's result can have."""

REFUSED = "refused.txt"
"""Why the last job in a folder was refused, or broke, beside the results of one before it, which stay."""


def site_folder(folder: Path, site: str, first: bool) -> Path:
    """Where a site's result lies: the first one's in the run's folder itself, any other's in a folder of the site's name."""
    return folder if first else folder / site.replace(":", "-")


def is_finished(folder: str | Path, sites: list[str], identity: dict, pictures: bool = False) -> bool:
    """Whether each of `sites`, by name, has a result of the same settings, data and version in which no mapper failed, with `pictures` if
    they are asked for, and nothing is left to be written."""
    if (Path(folder) / UNFINISHED).exists():
        return False
    for number, site in enumerate(sites):
        path = site_folder(Path(folder), site, first=not number) / RESULT
        try:
            result, about = read_result(path)
        except InputError:  # missing, damaged, or of another version: to be made again
            return False
        if result.failed or result.site != site or about.get("config_hash") != hash_of(identity):
            return False
        if pictures and result.scores and not (path.parent / PICTURES).is_dir():
            return False
    return bool(sites)


def is_trained(folder: str | Path, training_hash: str | None = None) -> bool:
    """Whether the training that was last begun in a folder has left its network there; with `training_hash`, whether that is its hash."""
    from hilbertvae.reconstruction.reconstructor import Reconstructor  # late: who only reads result files does not wait for it

    try:
        begun = json_object(Path(folder) / TRAINING)["training_hash"]
        ended = Reconstructor.load(Path(folder) / NETWORK).card["training_hash"]
    except (InputError, KeyError, TypeError):  # missing, damaged, or of another version: to be made again
        return False
    return begun == ended and training_hash in (None, ended)


def forget(folder: str | Path) -> None:
    """Remove the results that an earlier run left, of all its sites: a sweep whose job is stopped half-way, or is of fewer sites now, would
    otherwise count them as the job's."""
    for site in _site_folders(folder):
        _forget_site(site)
    for result in [Path(folder) / RESULT, *Path(folder).glob(f"*/{RESULT}")]:
        result.unlink(missing_ok=True)


def forget_other_sites(folder: str | Path, identity: dict) -> None:
    """After a run has written everything: remove the results of sites that an earlier one scored, and this one, of `identity`, did not."""
    for site in _site_folders(folder):
        if json_object(site / RESULT).get("config_hash") != hash_of(identity):
            _forget_site(site)


def _site_folders(folder: str | Path) -> list[Path]:
    """The folders, in a run's own, of its further sites' results; another run may have its folder there, too, with what only runs leave."""
    found = []
    for result in Path(folder).glob(f"*/{RESULT}"):
        of_a_run = any((result.parent / name).exists() for name in (LOCK, TRAINING, NETWORK, CHECKPOINTS, TENSORBOARD))
        site = json_object(result).get("site")
        if not of_a_run and isinstance(site, str) and result.parent == site_folder(Path(folder), site, first=False):
            found.append(result.parent)
    return found


def _forget_site(folder: Path) -> None:
    for name in (RESULT, SCORES):
        (folder / name).unlink(missing_ok=True)
    clear_pictures(folder)


def has_result(folder: str | Path) -> bool:
    """Whether a run has left scores in `folder`, whatever its settings were."""
    try:
        return bool(read_result(Path(folder) / RESULT)[0].scores)
    except InputError:
        return False


def was_scored_alone(folder: str | Path) -> bool:
    """Whether an earlier run has scored into this folder, and none trained there, whose curves are in its TensorBoard."""
    return (Path(folder) / RESULT).exists() and not (Path(folder) / TRAINING).exists()


def clear(folder: str | Path) -> None:
    """Remove what else a scoring writes, where an earlier one was of another network: TensorBoard would show both as one run."""
    shutil.rmtree(Path(folder) / TENSORBOARD, ignore_errors=True)
    clear_pictures(folder)


def clear_pictures(folder: str | Path) -> None:
    """Remove what was drawn of a result, before another one is written beside it: not every scoring draws all, or any, of it anew."""
    shutil.rmtree(Path(folder) / PICTURES, ignore_errors=True)
    (Path(folder) / SURFACE).unlink(missing_ok=True)


def write_failure(folder: str | Path, config: dict, error: BaseException) -> Path:
    """`result.json` with status `failed`, for a run that broke. config: plain containers, as far as they are known."""
    config = finite(config)  # the value that was refused may be one that JSON has no word for
    evaluation, sites = config.get("evaluation") or {}, (config.get("data") or {}).get("test") or [""]
    diameter = float(evaluation.get("gap_ratio") or 0) * float(evaluation.get("cluster_size_m") or 0)
    broken = Result(
        site=str(sites[0]),
        dimension=int(config.get("dimension") or 0),
        gap_diameter_m=diameter if math.isfinite(diameter) else 0.0,
        gap_seeds=list(evaluation.get("gap_seeds") or []),
        ceiling={},
        failed={RUN: f"{type(error).__name__}: {error}"},
        protocol=dict(evaluation),
    )
    return write_result(Path(folder) / RESULT, broken, provenance(config, identity={"failed": True}))


def write_refusal(folder: str | Path, error: BaseException) -> None:
    """Beside results that stay: why a later job of the same folder did not start, or broke. `allow` takes it back."""
    kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "  # whose messages alone say what is wrong
    with atomic(Path(folder) / REFUSED) as temporary:
        temporary.write_text(f"{kind}{error}\n", encoding="utf-8")


def allow(folder: str | Path) -> None:
    """Before a job starts: what is said of an earlier one's refusal goes."""
    (Path(folder) / REFUSED).unlink(missing_ok=True)


def refusal(folder: str | Path) -> str | None:
    """Why the last job in `folder` was refused, or broke beside results that stay, if it was so."""
    path = Path(folder) / REFUSED
    return path.read_text(encoding="utf-8").strip() if path.exists() else None


def finite(node):
    """Plain containers with NaN and infinite numbers as text."""
    if isinstance(node, dict):
        return {key: finite(value) for key, value in node.items()}
    if isinstance(node, list):
        return [finite(value) for value in node]
    return str(node) if isinstance(node, float) and not math.isfinite(node) else node
