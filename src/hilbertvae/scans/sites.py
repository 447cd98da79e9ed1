"""The catalogue of real sites: where each log is, its hash, its role, and how it is read.

The 2D logs are classic SLAM data sets with corrected poses, collected at github.com/acschaefer/ple. That repository states no terms
for the data, so nothing of it is shipped: it is taken from a folder that the user has, or downloaded when the user asks for it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pooch

from hilbertvae.checks import InputError
from hilbertvae.files import file_sha256
from hilbertvae.scans.carmen import beam_step_deg, read_carmen
from hilbertvae.scans.scan import Scans

SOURCE_2D = "https://raw.githubusercontent.com/acschaefer/ple/cfcb5a7f12a793b616357381a688cfcc26eed347/data/carmen/"


@dataclass(frozen=True)
class CatalogueEntry:
    """One real site. Role is the site's part in the protocol: `train`, `validate` or `test`; it never changes."""

    name: str
    title: str
    file: str
    sha256: str
    role: str
    max_range_m: float
    """Ranges from here on are dropped: no-return codes, and returns too far to be trusted."""
    no_return_m: float
    """The smallest code that means 'no return'; always above `max_range_m`."""
    beams: int
    every: int = 1
    """Each so many-th scan is read; fr079's scans stand 0.1 m apart."""
    dimension: int = 2
    source: str = SOURCE_2D

    @property
    def step_deg(self) -> float:
        """Degrees between beams; the first points at -90."""
        return beam_step_deg(self.beams)


def _entry(name, title, file, beams, max_range_m, no_return_m, role, sha256, every=1) -> CatalogueEntry:
    return CatalogueEntry(name, title, f"{file}-corrected.log.gz", sha256, role, max_range_m, no_return_m, beams, every)


# fmt: off
CATALOGUE: dict[str, CatalogueEntry] = {entry.name: entry for entry in [
    _entry("fr079", "Freiburg, building 079", "freiburg-079", 360, 30, 81.91, "train", "0631d30baf4b9d1d209af47da9096e876e1b4cb3d5a2d68ef9c39c5a2360a466", every=4),
    _entry("fr101", "Freiburg, building 101", "freiburg-101", 360, 30, 81.91, "train", "7792de88bcb050f8edba92914aea75e8ec2fb73b483c01903bd2753aa655e982"),
    _entry("aces", "ACES3, Austin", "aces", 180, 40, 50.0, "train", "5434d44384166250608a64d3a8c32de84512f82c46cb60a2657f138592024569"),
    _entry("belgioioso", "Belgioioso castle", "belgioioso", 361, 30, 81.91, "train", "a130e3e6d9e5ec5e6a7f94cbb5cb6bca2df2626c7ed6bebb7b7a282253b10f6e"),
    _entry("fhw", "Museum, Athens", "fhw", 180, 40, 51.0, "train", "4233abbfbc15baaddc730aceb3482dc660b25c9d5757005fff97a3fe083595b8"),
    _entry("mit-infinite-corridor", "MIT infinite corridor", "infinite-corridor", 180, 40, 50.0, "train", "6a63c51eb97aa4e720fe207e91f926c283f77b4c534903983f9c5a6cbed6ebc4"),
    _entry("csail", "MIT CSAIL", "csail", 361, 26, 81.91, "validate", "a98de24fc319651f231f9a8625b78bf1972312b86f7b00d2ddc979c4ac92ae2d"),
    _entry("intel", "Intel Research Lab, Seattle", "intel", 180, 25, 81.83, "test", "71bef16e9926506cf7417995ef35ace09dbd5de067fd042a3aab85188b5480dc"),
    _entry("seattle", "University of Washington, Seattle", "seattle", 361, 30, 81.91, "test", "5719198036b788d78a877ca04efdbfb07c2518508310f51d49c198bf1956bb4b"),
    _entry("orebro", "Orebro University", "orebro", 181, 30, 32.7, "test", "39a189c64489b84996669bc484d6bd6864f8733029a280a0e549a0adaae08a82"),
    _entry("edmonton", "Convention centre, Edmonton", "edmonton", 180, 40, 51.1, "test", "96599a91e0cc9cb2570dbb92f92bbdf1e3a405b16aa99f6d3ce1a703011befdb"),
    _entry("acapulco", "Convention centre, Acapulco", "acapulco", 181, 45, 50.0, "test", "fbd19a018534dee751606a9520fd6be25c86f3d7f1f7d849b1834d047b330116"),
]}
# fmt: on


def data_folder() -> Path:
    """Where logs are looked for: `HILBERTVAE_DATA`, else `../shared/data` if it is there, else the user's cache folder."""
    chosen = os.environ.get("HILBERTVAE_DATA")
    if chosen:
        return Path(chosen)
    beside = Path("../shared/data")
    return beside if beside.is_dir() else Path(pooch.os_cache("hilbertvae"))


def find_site(name: str) -> CatalogueEntry:
    """The catalogue's entry; an `InputError` that lists the names if there is none."""
    if name not in CATALOGUE:
        raise InputError(f"site {name!r}: not in the catalogue; expected one of {', '.join(CATALOGUE)}")
    return CATALOGUE[name]


def site_path(name: str, folder: str | os.PathLike | None = None, download: bool = False, source: str | None = None) -> Path:
    """The path of a site's file, checked against its hash. With `download`, a file that is not there is fetched first.

    Raises `InputError` for a missing file (naming how to get it), a failed download, or a file whose hash differs.
    """
    entry = find_site(name)
    path = Path(folder or data_folder()) / f"{entry.dimension}d" / entry.file
    if not path.is_file():
        if not download:
            raise InputError(f"site {name!r}: {path} is not there; set HILBERTVAE_DATA to a folder that has it, or set data.download=true")
        _download(entry, path, source or entry.source)
    found = file_sha256(path)
    if found != entry.sha256:
        raise InputError(f"site {name!r}: {path} has sha256 {found}, expected {entry.sha256}; remove the file and fetch it again")
    return path


def _download(entry: CatalogueEntry, path: Path, source: str) -> None:
    try:
        pooch.retrieve(source + entry.file, known_hash=f"sha256:{entry.sha256}", fname=path.name, path=path.parent, progressbar=False)
    except Exception as error:  # pooch passes on whatever the transport raised
        raise InputError(f"site {entry.name!r}: download of {source + entry.file} failed: {error}") from error


def read_site(name: str, folder: str | os.PathLike | None = None, download: bool = False) -> Scans:
    """The scans of a site of the catalogue."""
    entry = find_site(name)
    path = site_path(name, folder, download)
    return read_carmen(path, max_range_m=entry.max_range_m, every=entry.every, step_deg=entry.step_deg)


def site_hashes(names: list[str]) -> dict[str, str]:
    """sha256 by name of those of `names` that are sites of the catalogue."""
    return {name: CATALOGUE[name].sha256 for name in names if name in CATALOGUE}
