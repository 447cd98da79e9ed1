"""Which sites a run trains on, is chosen by and scored on, and how simulated ones are drawn: the keys `data.*`."""

from __future__ import annotations

from dataclasses import dataclass, field

from hilbertvae.checks import InputError, check_count, check_not_negative
from hilbertvae.scans.formats import ReadingSettings
from hilbertvae.simulate.building import MOST_EXTENT_M
from hilbertvae.simulate.building_variety import check_variety
from hilbertvae.simulate.street import StreetSettings

USUAL = "usual"
"""How much simulated sites differ unless told otherwise."""


@dataclass
class DataSettings:
    """Which sites play which part: a name of the catalogue, `simulated:<seed>` (a building; in 3D a street, or a floor of a building as
    `street.variety` says), or a path."""

    train: list[str] = field(default_factory=list)
    validate: str = "simulated:900001"
    calibrate: list[str] = field(default_factory=list)
    """What the Hilbert Map's weights are learned on, if not on the site of `validate`: one building's need not be another's."""
    test: list[str] = field(default_factory=lambda: ["simulated:900002"])
    simulated: int = 0
    """Simulated buildings, in 3D streets, to train on, beside the sites of `train`."""
    simulated_first: int = 0
    """Seed of the first of them, those of the others follow: a training that goes on may see others than the one before."""
    simulated_clusterings: int = 2
    """Times each simulated site is clustered; real sites take `clustering.clusterings`."""
    simulated_scans: int = 700
    """At most so many sweeps in a simulated building."""
    simulated_extent_m: list[float] = field(default_factory=lambda: [30.0, 95.0])
    """Range of a simulated building's length."""
    simulated_variety: str = USUAL
    """How much simulated buildings differ: `usual`, or `wide`: smaller ones and other lasers, too. `data.street` has a key of its own."""
    street: StreetSettings = field(default_factory=StreetSettings)
    reading: ReadingSettings = field(default_factory=ReadingSettings)
    """How paths are read; the sites of the catalogue are read as it says."""
    folder: str | None = None
    """Where real sites lie; by default `HILBERTVAE_DATA`, else ../shared/data, else the user's cache folder."""
    download: bool = False
    """Fetch real sites that are not there."""
    cache: str = "outputs/cache"
    """Where training grids are kept, under the hash of what made them."""
    processes: int = 0
    """How many cluster sites at a time; 0: one per core."""

    def check(self, dimension: int) -> None:
        """An `InputError` that names the key for sites that can't be trained on, or that says nothing in so many dimensions."""
        if not self.train and not self.simulated:
            raise InputError("data.train: expected at least one site, or data.simulated buildings, got neither")
        for key in ("simulated", "simulated_first", "processes"):
            check_not_negative(getattr(self, key), f"data.{key}")
        check_count(self.simulated_scans, "data.simulated_scans")
        if self.simulated:
            check_count(self.simulated_clusterings, "data.simulated_clusterings")
        check_variety(self.simulated_variety, "data.simulated_variety")
        if len(extent := self.simulated_extent_m) != 2 or not 6 <= extent[0] <= extent[1] <= MOST_EXTENT_M:
            raise InputError(f"data.simulated_extent_m: expected two lengths from 6 to {MOST_EXTENT_M:g}, the shorter first, got {extent}")
        for key, value, drawn_in in (("simulated_variety", self.simulated_variety, 2), ("street.variety", self.street.variety, 3)):
            if value != USUAL and dimension != drawn_in:
                raise InputError(f"data.{key}: expected {USUAL} in {dimension}D, where it draws nothing, got {value!r}")
