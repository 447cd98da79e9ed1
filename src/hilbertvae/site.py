"""One place that was mapped, with its three fixed clouds and what is held out of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from hilbertvae.checks import InputError, check_cell_m
from hilbertvae.cloud import RESOLUTION_M, Cloud, fit_cloud, points_cloud, thinned_cloud, voted_cloud
from hilbertvae.files import file_stamps, hash_of, path_sha256
from hilbertvae.ground import Ground, find_ground
from hilbertvae.last_few import LastFew
from hilbertvae.observed_map import FINE
from hilbertvae.scans.formats import ReadingSettings, is_scan_path, read_scans_path
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.sites import find_site, read_site, site_path
from hilbertvae.simulate import SCENES
from hilbertvae.simulate.building import BuildingSettings, simulate_building
from hilbertvae.simulate.laser import check_sim_extra
from hilbertvae.simulate.street import StreetSettings, simulate_street
from hilbertvae.voxel_votes import VoxelVotes, voxel_votes

READ = 2
"""A site to train or validate on, and one to test on: scans of a drive can take a GB."""
REMEMBERED = 24
"""Gaps, and three cases, of five gap seeds, and what a site has once. Of a street each case takes 200 MB."""


@dataclass(frozen=True, eq=False)
class Site:
    """A site's scans and, made when first asked for, the clouds of METHOD 1 and 7. Seed 0 fixes the `points` cloud."""

    name: str
    scans: Scans
    resolution_m: float = 0.0
    _memory: LastFew = field(default_factory=partial(LastFew, REMEMBERED), init=False, repr=False, compare=False)

    def __post_init__(self):
        if not self.resolution_m:
            object.__setattr__(self, "resolution_m", RESOLUTION_M[self.scans.dimension])

    def __reduce__(self):
        """A copy, in another process too, makes its clouds itself: they are many times the scans."""
        return type(self), (self.name, self.scans, self.resolution_m)

    @property
    def dimension(self) -> int:
        return self.scans.dimension

    @cached_property
    def whole(self) -> Cloud:
        """The `fit` cloud of every beam: what a training site offers."""
        return thinned_cloud(self._votes)

    @cached_property
    def fit(self) -> Cloud:
        """The `fit` cloud without each tenth beam: what every mapper is given."""
        return thinned_cloud(self._fitted_votes)

    @cached_property
    def fine_fit(self) -> Cloud:
        """The `fit` cloud in voxels `FINE` times as fine: what a map with such cells is made of."""
        return fit_cloud(self._fitted, self.resolution_m / FINE)

    @cached_property
    def voxels(self) -> Cloud:
        """One point per voxel seen by any beam."""
        return voted_cloud(self._votes)

    @cached_property
    def voxels_held_out(self) -> np.ndarray:
        """(V,) bool: the voxels that a held-out beam crossed or ended in."""
        return self._seen_in(self._held_out_votes)

    @cached_property
    def voxels_fitted(self) -> np.ndarray:
        """(V,) bool: the voxels that a fitted beam crossed or ended in."""
        return self._seen_in(self._fitted_votes)

    @cached_property
    def points(self) -> Cloud:
        """Returns and a few free points per beam, of every beam."""
        return self._points[0]

    @cached_property
    def points_held_out(self) -> np.ndarray:
        """(N,) bool: the points of held-out beams."""
        return self.scans.held_out()[self._points[1]]

    @cached_property
    def _points(self) -> tuple[Cloud, np.ndarray]:
        return points_cloud(self.scans, self.resolution_m)

    @cached_property
    def ground(self) -> Ground:
        """The local ground of a 3D site, found from all of its returns: scores are split by it, and no mapper knows it."""
        return find_ground(self.scans.points)

    @property
    def _fitted(self) -> Scans:
        """The returns of beams that are not held out."""
        fitted = self.scans.select(~self.scans.held_out())
        if len(self.scans) and not len(fitted):
            raise InputError("scans: expected beams beside the held-out ones, got none; number the beams of a sweep from 0 on")
        return fitted

    @cached_property
    def _fitted_votes(self) -> VoxelVotes:
        return voxel_votes(self._fitted, self.resolution_m)

    @cached_property
    def _held_out_votes(self) -> VoxelVotes | None:
        held_out = self.scans.held_out()
        return voxel_votes(self.scans.select(held_out), self.resolution_m) if held_out.any() else None

    @cached_property
    def _votes(self) -> VoxelVotes:
        """Beams are sampled once: those that were fitted and those that were held out, and then both together."""
        return self._fitted_votes.merged(self._held_out_votes) if self._held_out_votes else self._fitted_votes

    def remember(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What `make()` gave when `key` was last asked for, if it is among the `REMEMBERED` last: every mapper is shown the same."""
        return self._memory.get(key, make)

    def _seen_in(self, votes: VoxelVotes | None) -> np.ndarray:
        every = self._votes.index
        low = every.min(axis=0)
        shape = tuple(every.max(axis=0) - low + 1)
        seen = votes.index if votes else every[:0]
        keys = [np.ravel_multi_index(tuple((index - low).T), shape) for index in (every, seen)]
        return np.isin(*keys, assume_unique=True)


SIMULATED = "simulated:"


@dataclass(frozen=True)
class SiteSource:
    """How references to sites are read: where files lie, what dimension is asked for, and how sites are simulated."""

    dimension: int | None = None
    """2 or 3: anything else is refused, and `simulated:<seed>` is a street in 3D, or a floor. Unless given, any, and a building."""
    folder: str | None = None
    download: bool = False
    building: BuildingSettings = field(default_factory=BuildingSettings)
    street: StreetSettings = field(default_factory=StreetSettings)
    reading: ReadingSettings = field(default_factory=ReadingSettings)
    """How paths are read; a site of the catalogue is read as that says."""

    def __post_init__(self):
        if self.dimension not in (None, 2, 3):
            raise InputError(f"dimension: expected 2 or 3, got {self.dimension!r}")

    def check(self, reference: str) -> None:
        """Whether `scans` can start on a reference, before anything long is begun; fetches what is to be fetched."""
        if reference.startswith(SIMULATED):
            if not reference.removeprefix(SIMULATED).isdecimal():
                raise InputError(f"site {reference!r}: expected simulated:<seed>, a whole number")
            check_sim_extra()
        elif is_scan_path(reference):
            self.scans(reference)  # there is no other way to know
        else:
            self._check_dimension(reference, find_site(reference).dimension)
            site_path(reference, self.folder, self.download)

    def scans(self, reference: str) -> Scans:
        """The scans of a site of the catalogue, of the simulated site `simulated:<seed>`, or at a path.

        Raises `InputError` for a reference that is none of these, for files that can't be read, and for another dimension.
        """
        if reference.startswith(SIMULATED):
            self.check(reference)
            seed = int(reference.removeprefix(SIMULATED))
            return simulate_street(self.street, seed) if self.dimension == 3 else simulate_building(self.building, seed)
        at_path = is_scan_path(reference)
        found = _scans_at(reference, self.reading) if at_path else read_site(reference, self.folder, self.download)
        self._check_dimension(reference, found.dimension)
        return found

    def _check_dimension(self, reference: str, found: int) -> None:
        if self.dimension not in (None, found):
            raise InputError(f"site {reference!r}: expected {self.dimension}D scans, as `dimension` says, got {found}D")

    def made_of(self, reference: str) -> dict:
        """What the scans of a reference depend on, for hashes: contents, never places."""
        if reference.startswith(SIMULATED):
            dimension = 3 if self.dimension == 3 else 2
            return {"site": reference, "simulated": asdict({2: self.building, 3: self.street}[dimension]), "scenes": SCENES[dimension]}
        if is_scan_path(reference):
            return {"site": path_sha256(reference), "reading": asdict(self.reading)}
        return {"site": asdict(find_site(reference))}


_scans_read = LastFew(READ)


def _scans_at(reference: str, reading: ReadingSettings) -> Scans:
    """The scans at a path, read once while its files stay as they are: a run checks a site, clusters it several times and scores it, and
    each time all messages of a bag would be parsed, or poses be found, again. The `READ` last are kept."""
    path = Path(os.path.realpath(reference))
    key = hash_of([str(path), file_stamps(path), asdict(reading)])
    return _scans_read.get(key, lambda: _kept_as_is(read_scans_path(reference, reading)))


def _kept_as_is(scans: Scans) -> Scans:
    """The same, which nobody may change any more: others will be given them, too."""
    for values in (scans.points, scans.origins, scans.scan, scans.beam):
        values.flags.writeable = False
    return scans


def site_name(reference: str) -> str:
    """The name of a reference's site: that of the file or folder at a path, else the reference itself."""
    name = os.path.basename(os.path.realpath(reference)) if is_scan_path(reference) else reference
    return name.encode("utf-8", "replace").decode()  # one of another encoding can't be written


def open_site(reference: str | os.PathLike, resolution_m: float = 0.0, source: SiteSource | None = None) -> Site:
    """A place to map, to train on or to score on; its `scans` have `points` and `origins`, (N, D) in metres, a row for each return.

    reference: a path (log, bag, cloud, folder), a name of the catalogue (`intel`), or `simulated:<seed>`, a building unless `source` has
    dimension 3. resolution_m: side of its voxels in metres; 0.1 in 2D and 0.2 in 3D where it is 0. source: where data lie, and how paths
    are read. Raises `InputError` for what is none of these or can't be read, and for a resolution that is no size of a cell.
    """
    if resolution_m:
        check_cell_m(resolution_m, "resolution_m")
    reference = os.fspath(reference)
    return Site(site_name(reference), (source or SiteSource()).scans(reference), resolution_m)
