"""Sites that must stay what they are. The networks that come with the package were trained on such sites, and results in `docs` name them
by their seed alone: whoever changes a draw of the simulators makes other sites of all of them, and must mean it.

Numbers, not hashes: processors and libraries differ in last bits, which may move a return to the next surface, but no two or three of them.
"""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("shapely")

from hilbertvae.simulate.building import BuildingSettings, simulate_building  # noqa: E402
from hilbertvae.simulate.street import StreetSettings, simulate_street  # noqa: E402


def check(scans, count, middle, returns):
    """As many returns as committed, around the same middle, and some of them by scan and beam, in whole millimetres."""
    assert len(scans) == pytest.approx(count, abs=3)
    np.testing.assert_allclose(scans.points.round(3).mean(axis=0), middle, atol=0.005)
    found = {(int(scan), int(beam)): k for k, (scan, beam) in enumerate(zip(scans.scan, scans.beam, strict=True))}
    for key, point in returns.items():
        np.testing.assert_allclose(scans.points[found[key]].round(3), point, atol=0.0025, err_msg=f"scan and beam {key}")


def test_a_building_is_the_one_that_networks_were_trained_on():
    scans = simulate_building(BuildingSettings(shortest_extent_m=12, longest_extent_m=16, scans=30), 1)
    returns = {
        (0, 100): (-0.486, 6.888),
        (4, 172): (4.798, 3.389),
        (8, 238): (1.138, -0.372),
        (12, 304): (1.898, 3.212),
        (17, 15): (-0.95, 1.555),
        (21, 82): (-1.12, 0.599),
        (25, 159): (-8.309, 11.502),
        (29, 260): (-2.696, 1.12),
    }
    check(scans, 10713, (-0.0952, 2.8225), returns)


def test_a_street_is_the_one_that_networks_were_trained_on():
    scans = simulate_street(StreetSettings(azimuths=90, scans=3, single_scan_share=0.0, max_range_m=20.0), 1)
    returns = {
        (0, 179): (5.277, -0.742, -1.698),
        (0, 2260): (-9.077, -7.617, -0.827),
        (0, 4761): (6.265, 12.846, -1.474),
        (1, 1448): (1.681, -5.633, -1.197),
        (1, 3888): (-1.727, 5.76, -1.94),
        (2, 778): (7.178, -4.789, 0.045),
        (2, 2995): (-2.387, 0.438, -1.744),
        (2, 5599): (15.542, 2.378, -1.71),
    }
    check(scans, 13939, (1.1725, 0.6392, -1.2216), returns)
