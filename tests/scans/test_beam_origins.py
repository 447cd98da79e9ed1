import math

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.beam_origins import find_beam_origins


def test_the_two_blocks_of_an_hdl64_one_return_at_a_time():
    rng = np.random.default_rng(0)
    azimuth, elevation = rng.uniform(-math.pi, math.pi, 500), np.radians(rng.uniform(-25, 3, 500))
    flat = rng.uniform(3, 60, 500)
    points = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), flat * np.tan(elevation)])
    found = find_beam_origins("hdl64")(points)
    for (x, y, z), origin in zip(points.tolist(), found.tolist(), strict=True):
        above = math.degrees(math.asin(z / math.sqrt(x * x + y * y + z * z))) > -8.3
        assert origin == [0, 0, 0.20 if above else 0.12]
    assert len(np.unique(found[:, 2])) == 2


@pytest.mark.parametrize(
    ("choice", "place"), [("centre", [0, 0, 0]), ([1, 2.5, -3], [1, 2.5, -3]), ("0.1, 0,-0.2", [0.1, 0, -0.2]), (np.ones(3), [1, 1, 1])]
)
def test_one_place(choice, place):
    np.testing.assert_array_equal(find_beam_origins(choice)(np.zeros((4, 3))), [place] * 4)


@pytest.mark.parametrize("choice", ["hdl32", "", "1,2", "1,2,nan", [1, 2], [1, 2, "a"], None, 3, "1 2 3"])
def test_bad_choices(choice):
    with pytest.raises(InputError, match="reading.beam_origin: expected centre, hdl64 or three numbers"):
        find_beam_origins(choice)
