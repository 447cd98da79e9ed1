"""A surface in TensorBoard's mesh tab, small enough for a browser."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.drawing.lit_colours import surface_colours
from hilbertvae.drawing.surface import Surface
from hilbertvae.ground import Ground

MOST_VERTICES = 200_000
CELL_GROWTH = 1.25


def simplified(surface: Surface, most_vertices: int) -> Surface:
    """A surface of at most so many vertices: those in one cell of a lattice become one, and the cells grow until it fits.

    After Rossignac and Borrel (1993). A merged vertex is the mean of its own, and observed if half of them were.
    """
    if most_vertices < 1:
        raise InputError(f"most_vertices: expected a positive number, got {most_vertices!r}")
    if len(surface) <= most_vertices:
        return surface
    low = surface.vertices.min(axis=0)
    # About as many vertices as cells that a sheet of this area crosses.
    cell = np.sqrt(_area(surface) / most_vertices)
    while True:
        index = np.floor((surface.vertices - low) / cell).astype(np.int64)
        found, number = np.unique(np.ravel_multi_index(tuple(index.T), tuple(index.max(axis=0) + 1)), return_inverse=True)
        if len(found) <= most_vertices:
            break
        cell *= CELL_GROWTH
    count = np.bincount(number)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(number, weights=values) / count

    faces = number[surface.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    # Turned so that the smallest corner is first, which keeps the sense of rotation, equal faces are equal rows.
    faces = np.take_along_axis(faces, (np.arange(3) + faces.argmin(axis=1)[:, None]) % 3, axis=1)
    vertices = np.stack([mean(axis) for axis in (surface.vertices - low).T], axis=1) + low
    return Surface(vertices, np.unique(faces, axis=0), mean(surface.probability), mean(surface.observed) >= 0.5)


def _area(surface: Surface) -> float:
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def add_surface(writer, tag: str, surface: Surface, ground: Ground | None = None, most_vertices: int = MOST_VERTICES) -> None:
    """Write a surface to `writer`, a `SummaryWriter`; its colours are `surface_colours`. An empty surface is left out.

    It is moved to the origin, since float32 does not hold map coordinates such as UTM to the centimetre, and turned: up is y there.
    """
    surface = simplified(surface, most_vertices)
    if not len(surface.faces):
        return
    x, y, z = (surface.vertices - (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2).T.astype(np.float32)
    colours = surface_colours(surface, ground)
    writer.add_mesh(tag, np.stack([x, z, -y], axis=1)[None], colours[None], surface.faces.astype(np.int32)[None], global_step=0)
