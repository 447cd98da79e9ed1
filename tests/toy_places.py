"""Sites that the tests of drawing and of reports share: a room, and a street of a plane, a box car and a cylinder tree."""

import numpy as np

from hilbertvae.gaps import Gaps
from hilbertvae.scans.scan import Scans
from hilbertvae.site import Site

WIDTH_M, HEIGHT_M = 10.0, 6.0
"""Of the room."""
CAR = np.array([[3.0, 2.0, 0.0], [7.0, 3.8, 1.5]])
"""Two corners."""
TREE, TREE_RADIUS_M, TREE_M = np.array([12.0, 4.0]), 0.5, 4.5
STREET_M = np.array([16.0, 8.0])


def room(dimension=2, sweeps=6, beams=720, name="room"):
    """A room of 10 x 6 m with its lower left corner at the origin, seen from around its middle; in 3D with beams up and down."""
    rng = np.random.default_rng(0)
    points, origins = [], []
    for _ in range(sweeps):
        origin = np.array([WIDTH_M / 2, HEIGHT_M / 2]) + rng.uniform(-1, 1, 2)
        angle = np.linspace(0, 2 * np.pi, beams, endpoint=False)
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        with np.errstate(divide="ignore"):
            wall = np.where(direction > 0, np.array([WIDTH_M, HEIGHT_M]) - origin, -origin) / direction
        reach = np.where(np.isfinite(wall), wall, np.inf).min(axis=1)
        points.append(origin + reach[:, None] * direction)
        origins.append(np.broadcast_to(origin, (beams, 2)))
    points, origins = np.concatenate(points), np.concatenate(origins)
    scan, beam = np.repeat(np.arange(sweeps, dtype=np.int32), beams), np.tile(np.arange(beams, dtype=np.int32), sweeps)
    if dimension == 3:
        height = np.random.default_rng(1).uniform(-1, 1, len(points))
        points, origins = np.column_stack([points, 1.0 + height]), np.column_stack([origins, np.ones(len(origins))])
    return Site(name, Scans(points, origins, scan, beam))


def in_street(points):
    """(N,) bool: points in the ground, 0.4 m thick, the car or the tree."""
    x, y, z = points.T
    ground = (np.abs(z + 0.2) <= 0.2) & (x >= 0) & (y >= 0) & (x <= STREET_M[0]) & (y <= STREET_M[1])
    car = ((points >= CAR[0]) & (points <= CAR[1])).all(axis=1)
    tree = (np.hypot(x - TREE[0], y - TREE[1]) <= TREE_RADIUS_M) & (z >= 0) & (z <= TREE_M)
    return ground | car | tree


def street(sweeps=5, beams=4000):
    """The street's `Site`, seen from a drive past car and tree: beams marched in steps of 5 cm until they are in something."""
    points, origins, scans, numbers = [], [], [], []
    for sweep, x in enumerate(np.linspace(1.0, 15.0, sweeps)):
        origin = np.array([x, 0.3, 1.8])
        rng = np.random.default_rng(sweep)
        turn, tilt = rng.uniform(0, np.pi, beams), np.radians(rng.uniform(-40, 25, beams))
        direction = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
        reach = np.full(beams, np.inf)
        for metres in np.arange(0.2, 20, 0.05):
            reach = np.where(np.isinf(reach) & in_street(origin + metres * direction), metres, reach)
        beam = np.flatnonzero(np.isfinite(reach))
        points.append(origin + reach[beam, None] * direction[beam])
        origins.append(np.broadcast_to(origin, (len(beam), 3)))
        scans.append(np.full(len(beam), sweep, np.int32))
        numbers.append(beam.astype(np.int32))
    return Site("street", Scans(*(np.concatenate(parts) for parts in (points, origins, scans, numbers))))


def street_gaps(resolution_m=0.2):
    """A gap in the car, one in the tree, one in the bare ground."""
    return Gaps(np.array([[5.0, 2.2, 0.9], [12.0, 3.6, 2.0], [14.5, 1.5, 0.0]]), np.array([1.0, 1.0, 0.8]), resolution_m)
