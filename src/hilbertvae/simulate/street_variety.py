"""How much simulated streets differ: what the networks' own sites are like, or what else a lidar is carried through."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.simulate.shares import picked
from hilbertvae.simulate.spinning_lidar import SpinningLidar

if TYPE_CHECKING:  # it needs the extra `sim`
    from hilbertvae.simulate.street_plan import StreetPlan

HILLY = ("outskirts", "park")
"""Where ground may be uneven; elsewhere houses and kerbs stand on it, which need it as it is."""


@dataclass(frozen=True)
class Variety:
    """characters: shares of the kinds of streets. sensors: of the sensors. where: how many times as often as others a sensor's
    carrier is in such streets.

    robots: share of sensors on small robots, which see no car of their own, lie lower, and are in parks `robots_in_parks` times as often.
    most_relief: ground in `HILLY` streets may be so many times as uneven, and as steep.
    floors: share of sites that are no streets but floors of buildings (`floor.py`).
    """

    characters: dict[str, float]
    sensors: dict[str, float]
    where: dict[str, dict[str, float]]
    robots: float = 0.0
    robots_in_parks: float = 1.0
    most_relief: float = 1.0
    floors: float = 0.0

    @property
    def kind(self) -> str:
        """What its sites are, in the plural."""
        return "floors" if self.floors == 1 else "streets and floors" if self.floors else "streets"


VARIETIES = {
    "usual": Variety(
        characters={"residential": 0.48, "town": 0.27, "avenue": 0.07, "outskirts": 0.11, "park": 0.07},
        sensors={"hdl64": 0.6, "hdl32": 0.25, "os1": 0.15},
        # wide streets for nuScenes' cars, paths for a small robot
        where={"hdl32": {"avenue": 30.0, "outskirts": 3.0}, "os1": {"park": 12.0}},
    ),
    "wide": Variety(
        characters={"residential": 0.32, "town": 0.2, "avenue": 0.1, "outskirts": 0.18, "park": 0.2},
        sensors={"hdl64": 0.25, "hdl32": 0.25, "os1": 0.15, "vlp16": 0.1, "vlp32": 0.1, "os1_128": 0.15},
        where={},
        robots=0.4,
        robots_in_parks=4.0,
        most_relief=3.0,
    ),
}

VARIETIES["everywhere"] = replace(VARIETIES["wide"], floors=0.5)
VARIETIES["floors"] = replace(VARIETIES["wide"], floors=1.0)


def draw_character(rng: np.random.Generator, variety: Variety, sensor: str, robot: bool) -> str:
    """A kind of street, by where carriers of such a sensor are."""
    where = variety.where.get(sensor, {})
    shares = {name: share * where.get(name, 1.0) for name, share in variety.characters.items()}
    if robot:
        shares["park"] *= variety.robots_in_parks
    return picked(rng, shares)


@dataclass(frozen=True)
class Mount:
    """Where a sensor is mounted: on a robot or a car, how high, and the spread of its roll and pitch against what carries it.

    coarser: it fires so many times less often in a turn, as lidars that turn faster do.
    """

    robot: bool
    height_m: float
    tilt_deg: float
    coarser: int

    def carrying(self, lidar: SpinningLidar) -> SpinningLidar:
        """The sensor there: a robot hides what its posts hide, a car what a car of that height does."""
        placed = replace(lidar, height_m=self.height_m, azimuths=lidar.azimuths // self.coarser)
        return replace(placed, car=(), posts=4) if self.robot else placed


def draw_mount(rng: np.random.Generator, variety: Variety) -> Mount | None:
    """A mount, or None for the sensor's own."""
    if variety.robots == 0:
        return None
    robot = bool(rng.random() < variety.robots)
    height_m = rng.uniform(0.5, 1.5) if robot else rng.uniform(1.55, 2.3)
    return Mount(robot, float(height_m), 2.5 if robot else 0.6, int(rng.choice([1, 2], p=[0.7, 0.3])))


def hilly(rng: np.random.Generator, plan: StreetPlan, variety: Variety) -> StreetPlan:
    """The same plan on more uneven and steeper ground, where the variety has such."""
    if variety.most_relief == 1 or plan.character not in HILLY:
        return plan
    more = np.exp(rng.uniform(0, np.log(variety.most_relief), 2))
    flat = plan.ground
    steep = replace(flat, waves=flat.waves * [1, 1, 1, more[0]], slope=flat.slope * more[1], crossfall=flat.crossfall * more[1])
    return replace(plan, ground=steep)
