"""How much simulated buildings differ: what the networks' own sites are like, or what else a planar laser is carried through."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.simulate.laser import LaserSettings

SMALLEST_EXTENT_M = 10.0
"""Small buildings are from here up to the shortest of the others: flats, shops and laboratories."""

LASERS = {
    # Beams, field of view and range as in the makers' data sheets; noise is the one standard deviation at some metres.
    "utm30": dict(beams=1080, field_of_view_deg=270.0, max_range_m=30.0, range_noise_m=0.015, range_step_m=0.001),  # Hokuyo UTM-30LX
    "tim561": dict(beams=810, field_of_view_deg=270.0, max_range_m=10.0, range_noise_m=0.02, range_step_m=0.001),  # SICK TiM561
    "urg04": dict(beams=682, field_of_view_deg=240.0, max_range_m=5.6, range_noise_m=0.02, range_step_m=0.001),  # Hokuyo URG-04LX-UG01
    "a2": dict(beams=720, field_of_view_deg=360.0, max_range_m=12.0, range_noise_m=0.025, range_step_m=0.001),  # Slamtec RPLIDAR A2
    "lds01": dict(beams=360, field_of_view_deg=360.0, max_range_m=3.5, range_noise_m=0.025, range_step_m=0.001),  # TurtleBot3's LDS-01
}
"""Planar lasers beside that of the settings, whose default is a SICK LMS: what they differ in."""

OWN = "own"
"""The laser of the settings, among shares of lasers."""


@dataclass(frozen=True)
class BuildingVariety:
    """lasers: shares of the keys of `LASERS`, and of `OWN`. small: share of buildings that are smaller than the settings' shortest."""

    lasers: dict[str, float] = field(default_factory=lambda: {OWN: 1.0})
    small: float = 0.0


VARIETIES = {
    "usual": BuildingVariety(),
    "wide": BuildingVariety(lasers={OWN: 0.3, "utm30": 0.2, "tim561": 0.1, "urg04": 0.1, "a2": 0.2, "lds01": 0.1}, small=0.3),
}


def check_variety(name: str, key: str) -> None:
    """An `InputError` that names the key for what is no key of `VARIETIES`."""
    if not isinstance(name, str) or name not in VARIETIES:
        raise InputError(f"{key}: expected one of {', '.join(VARIETIES)}, got {name!r}")


def draw_extent_m(
    rng: np.random.Generator, for_variety: np.random.Generator, variety: BuildingVariety, shortest_m: float, longest_m: float
) -> float:
    """About how long a building is. What makes it differ is drawn `for_variety`, so that usual ones stay what they were."""
    if for_variety.random() < variety.small:
        return for_variety.uniform(min(SMALLEST_EXTENT_M, shortest_m), shortest_m)
    return rng.uniform(shortest_m, longest_m)


def draw_laser(rng: np.random.Generator, for_variety: np.random.Generator, variety: BuildingVariety, own: LaserSettings) -> LaserSettings:
    """Another robot's laser: of the settings' kind with half or one degree between beams and another longest range, or of another
    kind; and with other noise, misses and mixing at edges."""
    kind = str(for_variety.choice(list(variety.lasers), p=list(variety.lasers.values())))
    beams, max_range_m = int(own.beams * rng.choice([1, 2])), own.max_range_m * rng.choice([0.85, 1.0, 1.3])
    laser = replace(own, **(LASERS[kind] if kind != OWN else {"beams": beams, "max_range_m": max_range_m}))
    return replace(
        laser,
        range_noise_m=laser.range_noise_m * rng.uniform(0.6, 1.8),
        miss_share=float(np.clip(laser.miss_share * rng.choice([0.3, 1.0, 3.0]), 0, 1)),
        edge_mix_share=float(np.clip(laser.edge_mix_share * rng.uniform(0.0, 2.0), 0, 1)),
    )
