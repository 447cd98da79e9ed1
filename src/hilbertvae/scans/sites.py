"""The catalogue of real sites: where each log is, its hash, its role, and how it is read.

The 2D logs are classic SLAM data sets with corrected poses, collected at github.com/acschaefer/ple. That repository states no terms
for the data, so nothing of it is shipped: it is taken from a folder that the user has, or downloaded when the user asks for it.

The 3D sites are excerpts of KITTI (Geiger et al. 2013; CC BY-NC-SA 3.0), nuScenes (Caesar et al. 2020; CC BY-NC-SA 4.0), NCLT
(Carlevaris-Bianco et al. 2016) and RELLIS-3D (Jiang et al. 2021; CC BY-NC-SA 3.0), with poses by scan matching, in KITTI's layout.
Nobody hands out these very excerpts, so they are only taken from a folder that the user has.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pooch

from hilbertvae.checks import InputError
from hilbertvae.files import path_sha256
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.scans.carmen_messages import beam_step_deg
from hilbertvae.scans.file_points import LIDAR_RANGE_M
from hilbertvae.scans.kitti import read_kitti
from hilbertvae.scans.scan import Scans

SOURCE_2D = "https://raw.githubusercontent.com/acschaefer/ple/cfcb5a7f12a793b616357381a688cfcc26eed347/data/carmen/"


@dataclass(frozen=True)
class CatalogueEntry:
    """One real site. Role is the site's part in the protocol: `train`, `validate` or `test`; it never changes."""

    name: str
    file: str
    sha256: str
    role: str
    max_range_m: float
    """Ranges from here on are dropped: no-return codes, and returns too far to be trusted."""
    dimension: int
    source: str | None = None
    """Address of the folder that has the file, where there is one."""
    every: int = 1
    """Only every n-th scan is read; fr079's scans stand 0.1 m apart."""
    beams: int = 0
    """Of a planar laser."""
    beam_origin: str = "centre"
    """Where the beams of a 3D scan start: a key of `BEAM_ORIGINS`, or three numbers. NCLT's clouds are in the robot's frame: its lidar
    stands 0.96 m above, and the rings of its lasers are sharpest when seen from there."""

    @property
    def step_deg(self) -> float:
        """Degrees between a planar laser's beams; the first points at -90."""
        return beam_step_deg(self.beams)


def _flat(name, file, beams, max_range_m, role, sha256, every=1) -> CatalogueEntry:
    return CatalogueEntry(name, f"{file}-corrected.log.gz", sha256, role, max_range_m, 2, SOURCE_2D, every, beams)


def _solid(name, role, beam_origin, sha256) -> CatalogueEntry:
    return CatalogueEntry(name, name, sha256, role, LIDAR_RANGE_M, 3, beam_origin=beam_origin)


# fmt: off
CATALOGUE: dict[str, CatalogueEntry] = {entry.name: entry for entry in [
    _flat("fr079", "freiburg-079", 360, 30, "train", "0631d30baf4b9d1d209af47da9096e876e1b4cb3d5a2d68ef9c39c5a2360a466", every=4),
    _flat("fr101", "freiburg-101", 360, 30, "train", "7792de88bcb050f8edba92914aea75e8ec2fb73b483c01903bd2753aa655e982"),
    _flat("aces", "aces", 180, 40, "train", "5434d44384166250608a64d3a8c32de84512f82c46cb60a2657f138592024569"),
    _flat("belgioioso", "belgioioso", 361, 30, "train", "a130e3e6d9e5ec5e6a7f94cbb5cb6bca2df2626c7ed6bebb7b7a282253b10f6e"),
    _flat("fhw", "fhw", 180, 40, "train", "4233abbfbc15baaddc730aceb3482dc660b25c9d5757005fff97a3fe083595b8"),
    _flat("mit-infinite-corridor", "infinite-corridor", 180, 40, "train", "6a63c51eb97aa4e720fe207e91f926c283f77b4c534903983f9c5a6cbed6ebc4"),
    _flat("csail", "csail", 361, 26, "validate", "a98de24fc319651f231f9a8625b78bf1972312b86f7b00d2ddc979c4ac92ae2d"),
    _flat("intel", "intel", 180, 25, "test", "71bef16e9926506cf7417995ef35ace09dbd5de067fd042a3aab85188b5480dc"),
    _flat("seattle", "seattle", 361, 30, "test", "5719198036b788d78a877ca04efdbfb07c2518508310f51d49c198bf1956bb4b"),
    _flat("orebro", "orebro", 181, 30, "test", "39a189c64489b84996669bc484d6bd6864f8733029a280a0e549a0adaae08a82"),
    _flat("edmonton", "edmonton", 180, 40, "test", "96599a91e0cc9cb2570dbb92f92bbdf1e3a405b16aa99f6d3ce1a703011befdb"),
    _flat("acapulco", "acapulco", 181, 45, "test", "fbd19a018534dee751606a9520fd6be25c86f3d7f1f7d849b1834d047b330116"),
    _solid("kitti_drive0005", "test", "hdl64", "58175d8638f54b3c68154a1553a24477480d533608be2b079eef4e97cf6eeea6"),
    _solid("kitti00_start", "validate", "hdl64", "785e927b23be5c1329b796fe537bd8b4393e84fcbf87b0d1efc3ed2678b61ede"),
    _solid("nuscenes_train", "train", "centre", "3843b15c3a39136069cc076d8977daa20d5d7d76322b143fc50eab01402bf5fb"),
    _solid("nuscenes_val", "train", "centre", "c4c44a4d7c11ac290959b52f7f9de478967027a93576a9c3f64ab71f883069b0"),
    _solid("single_kitti_obj_test_000007", "train", "hdl64", "93cb35e1b2da99782fb4e878920e350142c7ae7b1d1b725310c539519cd265a8"),
    _solid("single_kitti_obj_train_000000", "train", "hdl64", "5fc24e4c699e08ec5372930cd07601463ee793ddd6fb7593166ccbd4865118ce"),
    _solid("single_kitti_obj_train_000001", "train", "hdl64", "fe6ba3224f98848166b5a9f5648d286d274f89c7e605ce050f026e65ecde8eae"),
    _solid("single_kitti_obj_train_000002", "train", "hdl64", "2e69ab056d4e04a86617afe5fe0b26ffd1fed89cff79e1f5fe82bfe5dc9e7111"),
    _solid("single_kitti_raw_0079", "train", "hdl64", "5390dd8906b1e1c2dd4e067481cd9886287b95f71ef388872d1373bd35ab9d87"),
    _solid("single_kitti_raw_r115", "train", "hdl64", "8c4f9fe44fd2e79c140a51f364828c4a938906e7a99a199aacd41b572bef9e89"),
    _solid("single_kitti_raw_street", "train", "hdl64", "002eed94980123c3a754357541f45351cfe76cad2dda115c2517eedb81e25f27"),
    _solid("single_nclt", "train", "0, 0, 0.96", "0757fc2fc3c2a90e5b9075ec90244c95e75dbcb0a484a737b4c0ea14d3ea3774"),
    _solid("single_nuscenes_n008", "train", "centre", "3268bbe17ba20bfe9e6d793c09143b974d1d1bad4f08b672940ab1972c209613"),
    _solid("single_nuscenes_n015", "train", "centre", "81e6121dafe51eb0de7d8ece6442f404087cfbcf4f387dec2b50a30c7bdfba57"),
    _solid("single_rellis_os1_000104", "train", "centre", "d9855679c580340a9b856d4e499ebde6725e9cfaeaf56ebc65ec0631ff55ac0c"),
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
    """The catalogue's entry; an `InputError` that lists the names if there is none, and says how to mean a path of that name."""
    if name not in CATALOGUE:
        beside = f", or ./{name} for the {'folder' if os.path.isdir(name) else 'file'} here" if os.path.exists(name) else ""
        raise InputError(f"site {name!r}: not in the catalogue; expected one of {', '.join(CATALOGUE)}{beside}")
    return CATALOGUE[name]


def site_path(name: str, folder: str | os.PathLike | None = None, download: bool = False, source: str | None = None) -> Path:
    """The path of a site's file or folder, checked against its hash. With `download`, a file that is not there is fetched first.

    Raises `InputError` for a missing file (naming how to get it), a failed download, or a file whose hash differs.
    """
    entry = find_site(name)
    path = Path(folder or data_folder()) / f"{entry.dimension}d" / entry.file
    source = source or entry.source
    if not path.exists():
        if not download or not source:
            way_out = ", or set data.download=true" if source else "; it can't be downloaded"
            raise InputError(f"site {name!r}: {path} is not there; set HILBERTVAE_DATA to a folder that has it{way_out}")
        _download(entry, path, source)
    found = path_sha256(path)
    if found != entry.sha256:
        raise InputError(
            f"site {name!r}: {path} has sha256 {found}, expected {entry.sha256}{'; remove the file and fetch it again' if source else ''}"
        )
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
    if entry.dimension == 3:
        return read_kitti(path, entry.beam_origin, max_range_m=entry.max_range_m, every=entry.every)
    return read_carmen(path, max_range_m=entry.max_range_m, every=entry.every, step_deg=entry.step_deg)


def site_hashes(names: list[str]) -> dict[str, str]:
    """sha256 by name of those of `names` that are sites of the catalogue."""
    return {name: CATALOGUE[name].sha256 for name in names if name in CATALOGUE}
