"""One HTML file to look at a map with: before beside after, what was filled in, how sure it is, and in 3D a view that turns.

The file holds all it shows: no script, style or picture is fetched from anywhere.
"""

from __future__ import annotations

import base64
import html
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from string import Template

import numpy as np
from matplotlib.colors import Colormap, to_hex, to_rgb
from PIL import Image

from hilbertvae.checks import InputError
from hilbertvae.drawing.colours import GAP_COLOUR, PROBABILITY, UNCERTAINTY, WIDEST_STD
from hilbertvae.drawing.lit_colours import GAP_TINT, HEIGHT, HEIGHTS_M, LIT, LIT_TINT, UNCERTAINTY_TINT
from hilbertvae.exports.cell_heights import heights_above_ground
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.files import atomic
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE

TEMPLATE = Path(__file__).with_suffix(".html")
MOST_CELLS = 1_500_000
"""In 3D more voxels than these are joined, two to a side, until they fit: a browser has to hold and turn them."""
MOST_PIXELS = 4_096
"""Along a side of a 2D map's picture: a browser holds five of them, and those of phones refuse larger ones."""


def write_page(cells: MapCells, path: str | os.PathLike, title: str, tables: dict[str, list[list[str]]]) -> Path:
    """Write the page of a sampled map as `path`, whole or not there.

    tables: by heading, rows of text shown under the map. Raises `InputError` for a map without cells.
    """
    if not len(cells):
        raise InputError(f"{path}: expected a map with known cells, got none")
    data = _flat(cells) if cells.dimension == 2 else _solid(cells)
    data["filled"] = not cells.observed.all()
    hint = "drag to move" if data["dimension"] == 2 else "drag to turn, with shift or two fingers to move"
    coarser = f"; shown in cells of {data['resolution_m']:g} m" if data["resolution_m"] > cells.resolution_m else ""
    nothing = "" if cells.occupied.any() or data["dimension"] == 2 else "; nothing is occupied, this is the likeliest cell"
    text = Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=html.escape(title),
        unknown=to_hex(PROBABILITY(0.5)),
        hint=f"{hint}, wheel to come closer{coarser}{nothing}",
        tables="".join(_table(heading, rows) for heading, rows in tables.items()),
        data=json.dumps(data).replace("</", "<\\/"),
    )
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def _flat(cells: MapCells) -> dict:
    """Pictures of a 2D map, a pixel per cell; rows from the top. `filled` lies over `observed`."""
    cells, seen = cells.fitting(MOST_PIXELS)
    low, (columns, rows) = cells.box()
    filled = cells.select(~cells.observed)

    def picture(part: MapCells, colours: np.ndarray) -> str:
        pixels = np.zeros((rows, columns, 4), np.uint8)
        column, row = (part.index - low).T
        pixels[rows - 1 - row, column] = colours
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG", optimize=True)
        return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()

    def pictures(colours: Colormap, values: Callable[[MapCells], np.ndarray]) -> dict:
        return {name: picture(part, _byte(colours(values(part)))) for name, part in (("observed", seen), ("filled", filled))}

    likely = pictures(PROBABILITY, lambda part: part.probability.astype(float))
    modes = [{**_mode("probability", PROBABILITY, "free", "occupied"), **likely}]
    if _asked_how_sure(cells):
        modes.append({**_mode("uncertainty", UNCERTAINTY, "sure", "unsure"), **pictures(UNCERTAINTY, _uncertainty)})
    return {
        "dimension": 2,
        "resolution_m": cells.resolution_m,
        "corner_m": (low * cells.resolution_m).tolist(),
        "tint": picture(filled, np.array([*_byte(to_rgb(GAP_COLOUR)), 110], np.uint8)),
        "modes": modes,
    }


def _solid(cells: MapCells) -> dict:
    """The occupied voxels of a 3D map: three uint16 and four bytes each (height, probability, uncertainty, observed)."""
    occupied = cells.select(cells.occupied)
    if not len(occupied):
        occupied = cells.select(np.argsort(cells.probability)[-1:])  # an empty view would look like a fault of the page
    while len(occupied) > MOST_CELLS or np.ptp(occupied.index, axis=0).max() >= 1 << 16:
        occupied = occupied.joined(2)
    low = occupied.index.min(axis=0)
    place = occupied.index - low
    lowest_m, highest_m = HEIGHTS_M
    height = (heights_above_ground(occupied) - lowest_m) / (highest_m - lowest_m)
    values = [height, (occupied.probability - OCCUPIED_ABOVE) / (1 - OCCUPIED_ABOVE), _uncertainty(occupied), occupied.observed]
    maps = {
        "height": (GAP_TINT, HEIGHT, "ground", f"{highest_m:g} m above"),
        "probability": (LIT_TINT, LIT, "just occupied", "surely"),
        "uncertainty": (UNCERTAINTY_TINT, UNCERTAINTY, "sure", "unsure"),
    }
    ramps = [_byte(colours(np.linspace(0, 1, 256)))[:, :3] for _, colours, *_ in maps.values()]
    asked = [name for name in maps if name != "uncertainty" or _asked_how_sure(occupied)]
    return {
        "dimension": 3,
        "resolution_m": occupied.resolution_m,
        "span": (place.max(axis=0) + 1).tolist(),
        "cells": _packed(place.astype("<u2")),
        "values": _packed(_byte(np.column_stack(values))),
        "ramps": _packed(np.stack([*ramps, ramps[-1]])),
        "background": to_rgb("#e9ecef"),
        "modes": [{**_mode(name, *maps[name][1:]), "tint": to_rgb(maps[name][0])} for name in asked],
    }


def _asked_how_sure(cells: MapCells) -> bool:
    return bool((cells.std > 0).any())  # NaN from a mapper that can't tell, 0 where no network was asked


def _uncertainty(cells: MapCells) -> np.ndarray:
    return np.clip(np.nan_to_num(cells.std.astype(float)) / WIDEST_STD, 0, 1)


def _mode(name: str, colours: Colormap, low: str, high: str) -> dict:
    return {"name": name, "low": low, "high": high, "stops": [to_hex(colours(share)) for share in np.linspace(0, 1, 9)]}


def _byte(share) -> np.ndarray:
    return np.round(np.clip(np.asarray(share, float), 0, 1) * 255).astype(np.uint8)


def _packed(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def _table(heading: str, rows: list[list[str]]) -> str:
    head, *body = rows
    lines = "".join(_row("td", row) for row in body)
    return f"<table><caption>{html.escape(heading)}</caption><thead>{_row('th', head)}</thead><tbody>{lines}</tbody></table>"


def _row(tag: str, words: list[str]) -> str:
    cells = "".join(f"<{tag}>{html.escape(word)}</{tag}>" for word in words)
    return f"<tr>{cells}</tr>"
