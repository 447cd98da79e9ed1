"""Where things stand in rooms, in space: backs against walls, or free, clear of doors and of one another; and what hangs above."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely

from hilbertvae.simulate.furniture import BARE_PASSAGE, PASSAGE, Furnishing, lattice, main_angle, scattered, walls
from hilbertvae.simulate.room_furniture import AGAINST_WALLS, FREE, ON_WALLS, draw_somebody
from hilbertvae.simulate.shapes import turned
from hilbertvae.simulate.shares import picked
from hilbertvae.simulate.soup import Soup
from hilbertvae.simulate.vehicles import draw_vehicle

HALL_M2 = 70.0
"""A larger room is a hall, and holds what halls do."""
GARAGE_SHARE = 0.25
"""Of halls, those in which cars are parked."""
PARKED = ("saloon", "hatchback", "estate", "small", "suv", "van")
FREE_SHARE = 0.8
"""Free pieces are larger than those of plans, which count each chair: so many times as many of them."""
ON_WALLS_PER_M = 0.08


@dataclass(frozen=True)
class Piece:
    """soup: in metres of the plan, before that is turned; ground: the rectangle that it takes, or hangs above.

    floor: number of the floor it is on. stands: or hangs on a wall.
    """

    soup: Soup
    ground: shapely.Polygon
    floor: int
    stands: bool

    @property
    def top_m(self) -> float:
        return float(self.soup.triangles[..., 2].max())


@dataclass
class RoomFilling:
    """Furnishes floors of a plan in space: call it as `furniture.furnish` on one floor after the other, and then ask for `pieces`."""

    pieces: list[Piece] = field(default_factory=list)
    floors: int = 0

    def __call__(
        self, rng: np.random.Generator, floor: shapely.Polygon, amount: Furnishing, keep_clear: shapely.Geometry | None
    ) -> list[shapely.Polygon]:
        """Footprints of what stands on `floor`, which is as full as `amount` says."""
        use, room = _use(rng, floor, amount), _Room(floor, keep_clear, self.floors)
        self.floors += 1
        if use == "garage":
            _park(rng, room)
        else:
            for place, angle in _at_walls(rng, floor, rng.poisson(amount.along_walls_per_m * floor.length)):
                tilt = rng.normal(0, 0.1) if rng.random() < 0.1 else 0.0
                room.put(picked(rng, AGAINST_WALLS[use])(rng), place, angle + tilt)
            pieces_per_m2 = amount.tables_per_m2 + amount.chairs_per_m2 + amount.clutter_per_m2
            for often, per_m2 in ((FREE[use], FREE_SHARE * pieces_per_m2), ({draw_somebody: 1.0}, amount.people_per_m2)):
                for place in scattered(rng, floor, rng.poisson(per_m2 * floor.area)):
                    square = rng.random() < 0.75
                    angle = main_angle(floor) + rng.integers(4) * np.pi / 2 if square else rng.uniform(0, 2 * np.pi)
                    room.put(picked(rng, often)(rng), place, angle)
        for place, angle in _at_walls(rng, floor, rng.poisson(ON_WALLS_PER_M * floor.length)):
            room.hang(ON_WALLS[rng.integers(len(ON_WALLS))](rng), place, angle)
        self.pieces += room.pieces
        return [piece.ground for piece in room.pieces if piece.stands]


@dataclass
class _Room:
    """A floor, what is to be kept clear there, its number, and what is there already."""

    floor: shapely.Polygon
    keep_clear: shapely.Geometry | None
    number: int
    pieces: list[Piece] = field(default_factory=list)

    def __post_init__(self):
        for land in (self.floor, self.keep_clear):
            shapely.prepare(land)

    def put(self, soup: Soup, place: np.ndarray, angle_rad: float) -> None:
        """What stands where it says, unless that would be in a wall, before a door or in something else."""
        self._add(soup, place, angle_rad, stands=True)

    def hang(self, soup: Soup, place: np.ndarray, angle_rad: float) -> None:
        """What hangs on a wall, unless it would reach into a door, another wall or what stands below it."""
        self._add(soup, place, angle_rad, stands=False)

    def _add(self, soup: Soup, place: np.ndarray, angle_rad: float, stands: bool) -> None:
        ground, low_m = _footprint(soup, place, angle_rad), soup.triangles[..., 2].min()
        if not self.floor.contains_properly(ground) or (self.keep_clear is not None and self.keep_clear.intersects(ground)):
            return
        met = shapely.intersects(ground, [piece.ground for piece in self.pieces])
        if not any(piece.top_m > low_m for piece, meets in zip(self.pieces, met, strict=True) if meets):
            self.pieces.append(Piece(soup.moved([*place, 0.0], angle_rad), ground, self.number, stands))


def _park(rng, room: _Room) -> None:
    """Cars in rows, some places empty."""
    middle, reach, angle = lattice(room.floor)
    for row in np.arange(-reach, reach, rng.uniform(7.5, 11.0)):
        for at in np.arange(-reach, reach, 2.6):
            if rng.random() < 0.55:
                car, _, _ = draw_vehicle(rng, str(rng.choice(PARKED)))
                room.put(car, middle + turned(np.array([at, row]), angle), angle + np.pi / 2 + rng.normal(0, 0.03))


def _footprint(soup: Soup, place: np.ndarray, angle_rad: float) -> shapely.Polygon:
    """The rectangle that it takes."""
    flat = soup.triangles[..., :2].reshape(-1, 2)
    (x0, y0), (x1, y1) = flat.min(axis=0), flat.max(axis=0)
    return shapely.Polygon(place + turned(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), angle_rad))


def _use(rng, floor: shapely.Polygon, amount: Furnishing) -> str:
    if amount in (PASSAGE, BARE_PASSAGE):
        return "corridor"
    if floor.area > HALL_M2:
        return "garage" if rng.random() < GARAGE_SHARE else "hall"
    return str(rng.choice(["office", "store", "home"], p=[0.55, 0.2, 0.25]))


def _at_walls(rng, floor: shapely.Polygon, count: int):
    """Places a centimetre or more before a floor's walls, and the angle at which what stands there looks into the room."""
    corners, steps, lengths = walls(floor)
    for edge in rng.choice(len(steps), count, p=lengths / lengths.sum()):
        along = steps[edge] / lengths[edge]
        inward = np.array([along[1], -along[0]])
        gap = 0.01 if rng.random() < 0.7 else rng.uniform(0.01, 0.15)
        yield corners[edge] + rng.random() * steps[edge] + gap * inward, float(np.arctan2(-along[1], -along[0]))
