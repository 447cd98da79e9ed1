"""Which part each site plays: training and evaluation never share one (METHOD 0 and 7)."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.files import files_at, path_sha256
from hilbertvae.reconstruction.training_card import stages, trained_on
from hilbertvae.reports.run_folder import OWN_FOLDERS
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.scans.sites import CATALOGUE
from hilbertvae.site import SIMULATED, site_name

LARGEST_BYTES = 500_000_000
"""No site of the catalogue is as large, and to read what is would take long: it is known by its path alone."""


def check_roles(train: list[str], validate: str, test: list[str], calibrate: Sequence[str] = ()) -> None:
    """An `InputError` that names the key if a site plays two parts, if one of the catalogue's test sites is learned from in any way, or if
    results of two would lie in one folder. The site of `validate` may be among those of `calibrate`: neither is trained on."""
    places = {site: place(site) for site in (*train, *calibrate, *test)}
    trained = {places[site] for site in train}
    for key, sites in (("data.train", train), ("data.validate", [validate]), ("data.calibrate", calibrate)):
        scored = [site for site in sites if (entry := CATALOGUE.get(place(site))) and entry.role == "test"]
        if scored:
            raise InputError(f"{key}: {', '.join(scored)} is for tests alone, expected a site that results are not compared on")
    for key, sites in (("data.validate", [validate]), ("data.calibrate", calibrate)):
        for site in sites:
            if place(site) in trained:
                raise InputError(f"{key}: {site!r} is also trained on")
    known = {*trained, *map(place, [validate, *calibrate])}
    both = [site for site in test if places[site] in known or _lies_among(site, (*train, validate, *calibrate))]
    if both:
        raise InputError(f"data.test: {', '.join(both)} is also trained or validated on")
    for key, sites in (("data.train", train), ("data.calibrate", calibrate), ("data.test", test)):
        several = Counter(places[site] for site in sites)
        if twice := [site for site in sites if several[places[site]] > 1]:
            raise InputError(f"{key}: expected each site once, since one given twice would count double, got {', '.join(twice)}")
    names = [site_name(site) for site in test]
    if len(set(names)) < len(names):
        raise InputError(f"data.test: expected sites of different names, since results are kept under them, got {', '.join(names)}")
    if taken := OWN_FOLDERS.intersection(names[1:]):
        raise InputError(f"data.test: expected another name than {', '.join(taken)} for its results, since a run has a folder of that name")


def check_unseen(sites: list[str], card: dict, key: str, network: str) -> None:
    """An `InputError` if one of `sites`, of config key `key`, is among what a network was trained on, as its card says: at a path by what
    lies there, whatever it is called now, and by the path.

    network: which one, for the message. The site that it was validated on may be asked: that is where choices are made."""
    contents = {found for stage in stages(card) for found in stage.get("trained_on_sha256", {}).values()}  # older cards have none
    named, simulated = trained_on(card)
    trained = set(map(place, named))
    known = [site for site in sites if (at := place(site)) in trained or any(_number(at) in many for many in simulated)]
    found = {site: CATALOGUE[site].sha256 for site in sites if site in CATALOGUE} | (own_sites(sites) if contents else {})
    known += [site for site in sites if found.get(site) in contents and site not in known]
    if known:
        raise InputError(f"{key}: {', '.join(known)} is among what {network} was trained on")


def own_sites(references: Iterable[str]) -> dict[str, str]:
    """sha256 by reference of those sites that are at paths, but for what would take long to read."""
    return {site: found for site in references if is_scan_path(site) and (found := _contents(Path(site)))}


def place(reference: str) -> str:
    """One word for all spellings of a site: a simulated one's plain number, the catalogue's name also for a copy of its files, and for
    copies of others one sha256."""
    if (number := _number(reference)) is not None:
        return f"{SIMULATED}{number}"
    if not is_scan_path(reference):
        return reference
    path = Path(os.path.realpath(reference))
    found = _contents(path)
    return next((entry.name for entry in CATALOGUE.values() if entry.sha256 == found), found or str(path))


def _lies_among(site: str, others: Sequence[str]) -> bool:
    """Whether a site's files are some of another's, as one scan of a folder, or the other way round."""
    path, paths = Path(os.path.realpath(site)), [Path(os.path.realpath(other)) for other in others if is_scan_path(other)]
    return is_scan_path(site) and any(path.is_relative_to(other) or other.is_relative_to(path) for other in paths)


def _contents(path: Path) -> str | None:
    """The sha256 of what lies at a path; None of nothing, and of what is too large."""
    return path_sha256(path) if 0 < sum(file.stat().st_size for file in files_at(path)) < LARGEST_BYTES else None


def _number(reference: str) -> int | None:
    """The seed of a simulated site; None for any other."""
    number = reference.removeprefix(SIMULATED)
    return int(number) if number != reference and number.isdecimal() else None
