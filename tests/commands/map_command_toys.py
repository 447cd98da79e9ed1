"""Scans as a file."""

import numpy as np


def npz_of(site, path):
    scans = site.scans
    np.savez(path, points=scans.points, origins=scans.origins, scan=scans.scan)
    return path
