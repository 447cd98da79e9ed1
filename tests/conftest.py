"""Fixtures that the whole suite shares."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from hilbertvae.scans.sites import CATALOGUE
from hilbertvae.site import Site
from toy_rooms import box_room, square_room

# Machines are noisy: no deadlines. The suite tries the same examples each time, and so tells of the code alone; `make fuzz` tries others.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.register_profile("fuzz", deadline=None)
settings.load_profile("suite")


@pytest.fixture(scope="session")
def room() -> Site:
    """A square room with a pillar, 2D."""
    return Site("room", square_room())


@pytest.fixture(scope="session")
def box() -> Site:
    """A box room with a pillar, 3D."""
    return Site("box", box_room())


@pytest.fixture(scope="session", params=["room", "box"])
def place(request) -> Site:
    """Both rooms, one after the other."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real sites, which need not be there."""
    chosen = os.environ.get("HILBERTVAE_DATA")
    return Path(chosen) if chosen else Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def real_scans(real_data) -> list[Path]:
    """Files of real 3D scans as KITTI has them; skips without any."""
    files = sorted(real_data.glob("3d/*/velodyne/*.bin"))
    if not files:
        pytest.skip("no real scans here; set HILBERTVAE_DATA to a folder that has them")
    return files


@pytest.fixture(scope="session")
def real_sites(real_data) -> dict[str, Path]:
    """Files and folders of the catalogue's sites that are on this machine, by name; skips without any."""
    paths = {name: real_data / f"{entry.dimension}d" / entry.file for name, entry in CATALOGUE.items()}
    found = {name: path for name, path in paths.items() if path.exists()}
    if not found:
        pytest.skip("no real sites here; set HILBERTVAE_DATA to a folder that has them")
    return found
