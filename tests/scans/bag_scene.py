"""A scene as bags of each kind: a robot with a lidar and a laser drives on a line; and what of its points is true."""

import warnings

import numpy as np
from bag_writers import bag, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag

MAP_ODOM = ((456_789.0, 5_428_345.5, 12.0), turned(0.7))
LIDAR_ON_BASE = ((0.3, -0.1, 1.2), turned(0.2, 0.1, -0.05))
LASER_ON_BASE = ((0.25, 0.0, 0.3), turned(0.4, 0.0, np.pi))
"""Mounted upside down: its beams are counted the other way round."""
RNG = np.random.default_rng(5)
CLOUDS = RNG.uniform(-20, 20, (4, 12, 3)).astype(np.float32).astype(np.float64)
RANGES = RNG.uniform(1, 20, (4, 31)).astype(np.float32).astype(np.float64)


def base_in_odom(seconds):
    """A robot that drives on a line and turns at a constant rate, which interpolation finds to the last bits."""
    return (2.0 * seconds - 3.0, 0.5 * seconds, 0.01 * seconds), turned(0.3 * seconds - 1.0)


def write_scene(path, kind, compression=None, lasers=4, clouds=4, fixed=True, slash=""):
    """Scans at 0.35 s, 1.35 s ..., and transforms of every second: /tf has map (once), odom and base, /tf_static the sensors."""
    with bag(path, kind, compression) as made:
        made.transform("/tf_static", 0, slash + "base", slash + "lidar", LIDAR_ON_BASE)
        made.transform("/tf_static", 0, slash + "base", slash + "laser", LASER_ON_BASE)
        for second in range(6):
            if fixed:
                made.transform("/tf", second, slash + "map", slash + "odom", MAP_ODOM)
            made.transform("/tf", second, slash + "odom", slash + "base", base_in_odom(second))
        for number in range(clouds):
            made.cloud("/points", number + 0.35, slash + "lidar", CLOUDS[number], rows=1 + number % 2)
        for number in range(lasers):
            made.laser("/scan", number + 0.35, slash + "laser", RANGES[number])
    return path


def laser_points(ranges, first=-np.pi / 2, step=np.pi / 180):
    """Where the beams of a planar laser end, one after the other; the message's angles are float32."""
    first, step = float(np.float32(first)), float(np.float32(step))
    rows = [(length * np.cos(first + step * beam), length * np.sin(first + step * beam), 0.0) for beam, length in enumerate(ranges)]
    return np.array(rows)


def bag_file(path):
    """The file that holds a bag's messages."""
    return next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap")) if path.is_dir() else path


def read_or_refuse(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            read_bag(path)
        except InputError as error:
            assert str(path) in str(error)
