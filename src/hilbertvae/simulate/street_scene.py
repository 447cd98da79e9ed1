"""What a scene of a street is: ground, things that stand on it, and things that move."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from hilbertvae.simulate.kerb_lines import Line
from hilbertvae.simulate.land import Land, footprint, shrunk
from hilbertvae.simulate.soup import Soup, joined
from hilbertvae.simulate.street_plan import StreetPlan
from hilbertvae.simulate.terrain import StreetGround, ground_soup

OWN_CAR_M = (4.6, 1.9)
"""Length and breadth of the car that carries the sensor."""


@dataclass(frozen=True)
class Thing:
    """A soup that stands on the ground at (s, t) of the plan and faces `angle_rad` there.

    draped: each of its places keeps its height above the ground, as what is long or has wheels; else it stands upright.
    """

    kind: str
    soup: Soup
    s: float
    t: float
    angle_rad: float = 0.0
    draped: bool = False

    def footprint(self) -> shapely.Geometry:
        """The land it takes, in the plan."""
        return footprint(self.kind, self.soup, (self.s, self.t), self.angle_rad)

    def in_world(self, ground: StreetGround) -> Soup:
        """Its triangles in metres of the world, standing on the ground, or laid over it if `draped`."""
        if not self.draped:
            return self.soup.moved(ground.place(self.s, self.t), self.angle_rad + ground.heading(self.s))
        local = self.soup.triangles
        cosine, sine = np.cos(self.angle_rad), np.sin(self.angle_rad)
        s, t = self.s + cosine * local[..., 0] - sine * local[..., 1], self.t + sine * local[..., 0] + cosine * local[..., 1]
        raised = ground.height(self.s, self.t) - ground.level(self.s, self.t)
        return Soup(np.stack([*ground.in_world(s, t), local[..., 2] + ground.level(s, t) + raised], axis=-1), self.soup.surface)


@dataclass(frozen=True)
class Mover:
    """A thing that goes `step_m` ahead between one scan and the next; with `turns_after`, that many scans to and fro, from scan 0 on."""

    thing: Thing
    step_m: float
    turns_after: int | None = None

    def at_scan(self, k: int) -> Thing:
        """The thing where it is in scan `k`."""
        angle, back = self.thing.angle_rad, False
        if self.turns_after is not None:
            k = k % (2 * self.turns_after) if self.turns_after else 0
            back = k > self.turns_after
            k = 2 * self.turns_after - k if back else k
        s, t = self.thing.s + k * self.step_m * np.cos(angle), self.thing.t + k * self.step_m * np.sin(angle)
        return replace(self.thing, s=float(s), t=float(t), angle_rad=angle + np.pi * back)

    def footprints(self, scans: np.ndarray) -> np.ndarray:
        """(S,) the land that it takes in each of `scans (S,)`, without its edge."""
        return np.array([shrunk(self.at_scan(k).footprint()) for k in scans])


@dataclass
class Scene:
    """Ground, things that stay, and things that move."""

    plan: StreetPlan
    drive_m: float
    bare_trees: bool = False
    things: list[Thing] = field(default_factory=list)
    movers: list[Mover] = field(default_factory=list)

    def __post_init__(self):
        self._land = Land(self.plan.ground.road, self.plan.kept_free)

    def add(self, kind: str, soup: Soup, line: Line, x: float, y: float, turn_rad: float = 0.0, draped: bool = False) -> None:
        """A thing at (x, y) of a line, unless something stands there; its own x runs along the line, its y away from the road."""
        s, t = line.at(x, y)
        self.put(Thing(kind, soup, float(s), float(t), line.angle_rad + turn_rad, draped))

    def put(self, thing: Thing) -> None:
        """A thing where it says, unless something stands there."""
        if self._land.take(thing.kind, thing.footprint()):
            self.things.append(thing)

    def send(self, mover: Mover) -> None:
        """A mover from where it says on, unless something stands there."""
        if self._land.free(mover.thing.kind, mover.thing.footprint()):
            self.movers.append(mover)

    def clear_ways(self, lane_s: np.ndarray) -> None:
        """Nobody walks through anything in the scans that the sensor's car makes at `lane_s (S,)` of the plan: who walks turns back before
        what stands, and who would still come into something, or into somebody, is left out. Vehicles keep to their lanes, where nothing
        stands, and go first."""
        standing = shapely.STRtree([shrunk(thing.footprint()) for thing in self.things if thing.kind != "grass"])
        (length, breadth), lane_t = OWN_CAR_M, self.plan.lane_t
        ways = [shapely.box(lane_s - length / 2, lane_t - breadth / 2, lane_s + length / 2, lane_t + breadth / 2)]
        self.movers, sent = [], sorted(self.movers, key=lambda mover: mover.thing.kind != "vehicle")
        for mover in sent:
            steps = np.arange(len(lane_s))
            if mover.thing.kind == "person":
                blocked = standing.query(mover.footprints(steps), predicate="intersects")[0]
                mover = replace(mover, turns_after=max(int(blocked.min(initial=len(lane_s))) - 1, 0))
            way = mover.footprints(steps)
            met = standing.query(way, predicate="intersects").size or any(shapely.intersects(way, other).any() for other in ways)
            if mover.thing.kind == "vehicle" or not met:
                self.movers.append(mover)
                ways.append(way)

    def leaf_m(self, line: Line, x: float, y: float) -> float:
        """Facets grow with the distance from the drive: a far crown needs fewer of them to look the same."""
        s, t = line.at(x, y)
        away = np.hypot(max(0.0, -s, s - self.drive_m), t)
        return float(np.clip(0.13 + 0.009 * away, 0.17, 0.8))

    def soup(self) -> Soup:
        """All that stays, in the world."""
        ground = self.plan.ground
        return joined([ground_soup(ground, self.plan.extent, self.plan.grass), *(thing.in_world(ground) for thing in self.things)])
