"""Whose the land of a street is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.simulate.soup import boxes_3d, joined

shapely = pytest.importorskip("shapely")

from hilbertvae.simulate.land import Land, footprint  # noqa: E402
from hilbertvae.simulate.shapes import turned  # noqa: E402

ROAD = shapely.box(-20, -3, 20, 3)


def square(x, y, side_m=2.0):
    return shapely.box(x - side_m / 2, y - side_m / 2, x + side_m / 2, y + side_m / 2)


@pytest.fixture
def land():
    return Land(ROAD, shapely.box(5, 3, 9, 8))


@given(
    angle=st.floats(-7, 7),
    sizes=st.lists(st.tuples(*[st.floats(0.1, 5)] * 3), min_size=1, max_size=4),
    place=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
)
def test_a_footprint_holds_all_that_is_low(angle, sizes, place):
    soup = joined([boxes_3d([2.0 * k, 0, 0.6 * k], size) for k, size in enumerate(sizes)])
    found = footprint("bin", soup, place, angle)
    low = soup.triangles[soup.triangles[..., 2].min(axis=1) < 1.2][..., :2].reshape(-1, 2)
    assert shapely.covers(shapely.buffer(found, 1e-6), shapely.multipoints(turned(low, angle) + np.array(place)))
    spans = np.ptp(low, axis=0)
    assert shapely.area(found) == pytest.approx(spans[0] * spans[1], rel=1e-6)


def test_what_hangs_over_takes_no_land():
    crown = joined([boxes_3d([0, 0, 0], [0.3, 0.3, 3]), boxes_3d([0, 0, 2], [6, 6, 2])])
    assert shapely.area(footprint("tree", crown, (0, 0), 0.4)) == pytest.approx(0.09)
    assert footprint("tree", boxes_3d([0, 0, 2], [1, 1, 1]), (0, 0), 0.0).is_empty


def test_steps_before_a_house_are_no_land_of_its_own():
    house = joined([boxes_3d([5, 4, 0], [10, 8, 6]), boxes_3d([5, -0.5, 0], [1, 1, 0.4])])
    assert shapely.bounds(footprint("house", house, (0, 0), 0.0)) == pytest.approx((0, 0, 10, 8))
    assert shapely.bounds(footprint("bin", house, (0, 0), 0.0))[1] == pytest.approx(-1)


@pytest.mark.parametrize(("kind", "stands"), [("vehicle", True), ("person", True), ("house", False), ("tree", False), ("bin", False)])
def test_only_what_goes_there_stands_on_the_road(land, kind, stands):
    assert land.take(kind, square(0, 2.5)) is stands
    assert land.take(kind, square(0, 30))


def test_nobody_parks_before_an_entrance(land):
    assert not land.take("vehicle", square(6, 4))
    assert land.take("bush", square(6, 6))
    assert not land.take("bush", square(0, 2))


@pytest.mark.parametrize("kind", ["house", "vehicle", "tree", "lamp post"])
def test_land_is_taken_once(land, kind):
    assert land.take("vehicle", square(0, 10))
    assert not land.take(kind, square(1, 11))
    assert not land.take(kind, square(0, 10, 0.1)), "nothing within anything"
    assert land.take(kind, square(2, 10)), "neighbours touch"


@pytest.mark.parametrize("kind", ["house", "garage", "shelter"])
@pytest.mark.parametrize("barrier", ["hedge", "wall", "fence", "rail"])
def test_barriers_go_through_nothing_built(land, kind, barrier):
    assert land.take(kind, square(0, 20, 8))
    assert not land.take(barrier, shapely.box(-9, 19.8, 9, 20.2))


def test_bushes_grow_beside_cars(land):
    assert land.take("vehicle", square(0, 10))
    assert not land.take("bush", square(0.3, 10.3, 0.5))
    assert land.take("bush", square(0, 11.9))


def test_asking_takes_nothing(land):
    assert land.free("person", square(0, 10)) and land.take("vehicle", square(0, 10))
    assert not land.free("person", square(0, 10))


def test_hedges_grow_around_cars_and_through_no_house(land):
    assert land.take("vehicle", square(0, 10)) and land.take("house", square(0, 20, 8))
    assert land.take("hedge", shapely.box(-5, 9.8, 5, 10.2))
    assert not land.take("hedge", shapely.box(-9, 19.8, 9, 20.2))
    assert land.take("house", square(0, 11, 0.5)) is False
    assert land.take("house", shapely.box(2, 9.8, 5, 10.2)), "a hedge takes no land"


def test_grass_grows_everywhere(land):
    assert land.take("house", square(0, 20)) and land.take("grass", square(0, 20))
