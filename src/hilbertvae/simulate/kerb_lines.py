"""Kerbs as straight lines in a plan, and the lots along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

STYLES = {
    "residential": {"detached": 0.6, "terrace": 0.2, "apartments": 0.1, "green": 0.1},
    "town": {"terrace": 0.75, "apartments": 0.15, "green": 0.05, "works": 0.05},
    "avenue": {"apartments": 0.2, "terrace": 0.07, "green": 0.15, "works": 0.18, "open": 0.4},
    "outskirts": {"green": 0.4, "open": 0.25, "works": 0.2, "detached": 0.15},
    "park": {"green": 0.7, "open": 0.3},
}
"""Shares of what lots hold, by the character of the street."""

LOT_WIDTHS_M = {"detached": (11, 22), "terrace": (6, 14), "apartments": (20, 42), "green": (15, 40), "works": (25, 50), "open": (20, 40)}


@dataclass(frozen=True)
class Line:
    """A kerb: x runs along it from `start` (s, t) in direction `angle_rad` of the plan, y away from the road.

    pavement_m: to where lots begin. parking: "none", "along", "across" or "on kerb", and how full, from 0 to 1.
    """

    start: tuple[float, float]
    angle_rad: float
    length_m: float
    pavement_m: float
    parking: str = "none"
    fullness: float = 0.0
    main: bool = True

    def at(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """s and t of places on the line."""
        cosine, sine = np.cos(self.angle_rad), np.sin(self.angle_rad)
        return self.start[0] + cosine * x - sine * y, self.start[1] + sine * x + cosine * y


@dataclass(frozen=True)
class Lot:
    """A piece of land from x_m to x_m + width_m of a line. drive_m: where on it a drive leads to the kerb, or None."""

    line: Line
    x_m: float
    width_m: float
    style: str
    drive_m: float | None = None


def main_lines(low, high, widths, pavements, modes, fullness, mouths) -> list[Line]:
    """The kerbs of the street from s = low to s = high, right then left, cut at the mouths of side streets."""
    lines = []
    for side in (0, 1):
        stops = sorted((a, b) for a, b in mouths[side] if low < a and b < high)
        starts, ends = [low, *(b for _, b in stops)], [*(a for a, _ in stops), high]
        gap = pavements[side]
        for a, b in zip(starts, ends, strict=True):
            a, b = a + (gap if a > low else 0), b - (gap if b < high else 0)
            if b - a > 4:
                start = (a, widths[1]) if side else (b, -widths[0])
                lines.append(Line(start, 0.0 if side else np.pi, b - a, pavements[side], str(modes[side]), fullness))
    return lines


def side_lines(rng, s: float, side: int, half: float, width: float, fullness: float, beyond_m: float) -> list[Line]:
    """Both kerbs of a side street; lots begin behind the corner houses."""
    corner, pavement = width + rng.uniform(10, 18), rng.uniform(1.2, 2.5)
    if corner > beyond_m - 4:
        return []
    near, far = (corner, beyond_m) if side > 0 else (-beyond_m, -corner)
    mode = str(rng.choice(["none", "on kerb"]))
    return [
        Line((s + half, far), -np.pi / 2, far - near, pavement, mode, 0.6 * fullness, False),
        Line((s - half, near), np.pi / 2, far - near, pavement, "none", 0.0, False),
    ]


def lines_around(rng, s: float, ring: float, widths) -> list[Line]:
    """Short straight kerb lines around an open place, but where the street comes in."""
    lines = []
    length = rng.uniform(7, 11)
    free = np.arcsin(min((max(widths) + 2) / ring, 1.0)) + length / 2 / ring
    for way in np.arange(free, np.pi - free, length / ring):
        for phi in (way, -way):
            along = np.array([np.sin(phi), -np.cos(phi)])
            middle = np.array([s + ring * np.cos(phi), ring * np.sin(phi)])
            start = middle - along * length / 2
            lines.append(Line((float(start[0]), float(start[1])), phi - np.pi / 2, length, rng.uniform(2, 4), "none", 0.0, False))
    return lines


def draw_lots(rng, line: Line, character: str, car_parks: np.ndarray) -> list[Lot]:
    """Lots side by side along a line, with passages between some, and none where a car park lies."""
    styles = STYLES[character]
    style = rng.choice(list(styles), p=list(styles.values()))
    lots, x = [], 0.0
    while x < line.length_m - 4:
        if rng.random() < 0.3:
            style = rng.choice(list(styles), p=list(styles.values()))
        width = min(rng.uniform(*LOT_WIDTHS_M[style]), line.length_m - x)
        if width < LOT_WIDTHS_M[style][0]:
            style = "green"  # what is left over at the end of a kerb
        s, t = line.at(x + np.array([0, 0.5, 1]) * width, line.pavement_m + 3)
        over = [(s.max() > s0 - 1) & (s.min() < s1 + 1) & (t.max() > t0) & (t.min() < t1) for s0, t0, s1, t1 in car_parks]
        if not any(over):
            drive = _draw_drive(rng, str(style), width) if rng.random() < 0.75 else None
            lots.append(Lot(line, x, width, str(style), drive))
            if style == "terrace" and rng.random() < 0.12:
                x += rng.uniform(2.5, 6.0)  # a passage between houses
        x += width
    return lots


def _draw_drive(rng, style: str, width_m: float) -> float | None:
    """Where a drive leads into a lot: beside a house, anywhere to works."""
    if style == "works":
        return rng.uniform(1.8, width_m - 1.8)
    if style != "detached":
        return None
    from_side = rng.uniform(1.8, 0.3 * width_m)
    return from_side if rng.random() < 0.5 else width_m - from_side


def ribbon(line: Line, x0: float, x1: float, y0: float, y1: float) -> shapely.Polygon:
    """The rectangle from x0 to x1 and y0 to y1 of a line, in the plan."""
    return shapely.Polygon(np.stack(line.at(np.array([x0, x1, x1, x0]), np.array([y0, y0, y1, y1])), axis=-1))
