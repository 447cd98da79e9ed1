"""Sites that must stay what they are. Networks are trained on such sites, and results name them by their seed alone: whoever changes a draw
of the simulators makes other sites of all of them, must mean it, and counts `SCENES` up.

Numbers, not hashes: processors and libraries differ in last bits, which may move a return to the next surface, but no two or three of them.
"""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("shapely")

from hilbertvae.simulate import SCENES  # noqa: E402
from hilbertvae.simulate.building import BuildingSettings, simulate_building  # noqa: E402
from hilbertvae.simulate.street import StreetSettings, simulate_street  # noqa: E402


def test_these_are_the_numbers_of_the_current_scenes():
    assert SCENES == {2: 4, 3: 5}


def check(scans, count, middle, returns):
    """As many returns as committed, around the same middle, and some of them by scan and beam, in whole millimetres."""
    assert len(scans) == pytest.approx(count, abs=3)
    np.testing.assert_allclose(scans.points.round(3).mean(axis=0), middle, atol=0.005)
    found = {(int(scan), int(beam)): k for k, (scan, beam) in enumerate(zip(scans.scan, scans.beam, strict=True))}
    for key, point in returns.items():
        np.testing.assert_allclose(scans.points[found[key]].round(3), point, atol=0.0025, err_msg=f"scan and beam {key}")


def test_a_building_stays_what_it_is():
    scans = simulate_building(BuildingSettings(shortest_extent_m=12, longest_extent_m=16, scans=30), 1)
    returns = {
        (0, 101): (2.039, 2.254),
        (4, 187): (3.619, 1.25),
        (8, 210): (3.622, 1.323),
        (13, 4): (4.84, 5.229),
        (17, 172): (2.071, 3.883),
        (21, 202): (0.291, 2.655),
        (25, 229): (0.663, 1.315),
        (29, 258): (0.412, 1.371),
    }
    check(scans, 10422, (2.0646, 2.9079), returns)


def test_a_building_of_wide_variety_stays_what_it_is():
    """Scanned by a TiM561."""
    scans = simulate_building(BuildingSettings(shortest_extent_m=12, longest_extent_m=16, scans=30, variety="wide"), 2)
    returns = {
        (0, 103): (-3.286, 10.708),
        (6, 52): (-6.771, 11.873),
        (12, 21): (-4.343, 8.741),
        (17, 799): (-3.198, 8.422),
        (23, 755): (-4.308, 8.633),
        (29, 709): (-6.788, 11.874),
    }
    check(scans, 23963, (-3.923, 10.4634), returns)


def test_a_street_stays_what_it_is():
    scans = simulate_street(StreetSettings(azimuths=90, scans=3, single_scan_share=0.0, max_range_m=20.0), 1)
    returns = {
        (0, 177): (5.563, -0.782, -1.684),
        (0, 2139): (-5.225, -5.803, -0.81),
        (0, 4906): (4.195, 6.22, -1.775),
        (1, 1433): (1.759, -5.909, -0.488),
        (1, 3764): (-1.825, 4.314, -1.809),
        (2, 705): (5.37, -2.207, 0.304),
        (2, 2666): (-3.741, -1.978, -1.666),
        (2, 5601): (13.565, 2.217, -1.662),
    }
    check(scans, 13147, (1.5249, -0.3231, -1.2806), returns)


def test_a_street_of_wide_variety_stays_what_it_is():
    """A VLP-16 on a robot."""
    scans = simulate_street(StreetSettings(variety="wide", azimuths=90, scans=3, single_scan_share=0.0, max_range_m=20.0), 4)
    returns = {
        (0, 60): (6.105, -1.298, -0.989),
        (0, 938): (-2.227, 2.851, -0.317),
        (1, 344): (1.399, -4.889, -0.089),
        (1, 1147): (2.629, 6.954, -0.902),
        (2, 616): (-11.372, -6.984, -0.297),
        (2, 1394): (16.841, 3.148, 2.943),
    }
    check(scans, 2701, (0.9623, 0.5739, -0.1563), returns)


def test_a_floor_stays_what_it_is():
    scans = simulate_street(StreetSettings(variety="floors", azimuths=90, scans=3, single_scan_share=0.0), 1)
    returns = {
        (0, 0): (4.313, 0.146, 1.381),
        (0, 972): (-1.511, 2.609, -0.899),
        (1, 230): (4.036, -1.815, 0.106),
        (1, 1203): (3.388, 3.483, 0.757),
        (2, 465): (0.752, 4.264, 1.392),
        (2, 1439): (-0.561, -5.4, -1.341),
    }
    check(scans, 3473, (1.6719, -0.1985, 0.0433), returns)
