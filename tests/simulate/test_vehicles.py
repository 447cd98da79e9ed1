"""Vehicles: a car is no box."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from hilbertvae.simulate.soup import Surface  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402
from hilbertvae.simulate.vehicles import CARS, KINDS, car_soup, draw_vehicle  # noqa: E402


@pytest.mark.parametrize("kind", CARS)
def test_air_is_free_below_the_floor_and_the_wheels_stand_in_it(kind):
    shape = CARS[kind]
    caster = SurfaceCaster(car_soup(shape))
    axle = 0.5 * shape.wheelbase * shape.length_m
    x = np.array([0.0, 0.3, -0.3, axle, -axle])
    origins = np.column_stack([x, np.full(5, -5.0), np.full(5, 0.12)])
    found = caster.ranges(origins, np.tile([0, 1.0, 0], (5, 1)))
    assert np.isinf(found[:3]).all()
    np.testing.assert_allclose(found[3:], 5 - shape.width_m / 2, atol=0.15)


@pytest.mark.parametrize("kind", CARS)
def test_profile_rises_from_the_bonnet_to_the_roof(kind):
    shape = CARS[kind]
    caster = SurfaceCaster(car_soup(shape))
    nose = np.array([0.05, 0.5 * (shape.roof_front + shape.roof_rear)])
    origins = np.column_stack([shape.length_m * (0.5 - nose), np.zeros(2), np.full(2, 5.0)])
    bonnet, roof = 5.0 - caster.ranges(origins, np.tile([0, 0, -1.0], (2, 1)))
    assert bonnet == pytest.approx(shape.bonnet_m, abs=0.1)
    assert roof == pytest.approx(shape.height_m, abs=0.06)
    assert roof > bonnet + 0.4


@pytest.mark.parametrize("kind", CARS)
def test_windows_are_glass_and_doors_are_not(kind):
    shape = CARS[kind]
    caster = SurfaceCaster(car_soup(shape))
    x = shape.length_m * (0.5 - shape.roof_front) - 0.2
    heights = np.array([0.5, shape.belt_m + 0.2])
    origins = np.column_stack([np.full(2, x), np.full(2, -5.0), heights])
    _, surface, _ = caster.hits(origins, np.tile([0, 1.0, 0], (2, 1)))
    assert surface[0] == Surface.PAINT and surface[1] == Surface.GLASS


@pytest.mark.parametrize("kind", KINDS)
def test_drawn_vehicles_have_the_size_they_say(kind):
    vehicle, length, width = draw_vehicle(np.random.default_rng(3), kind)
    low, high = vehicle.triangles.min(axis=(0, 1)), vehicle.triangles.max(axis=(0, 1))
    assert high[0] - low[0] == pytest.approx(length, abs=0.05)
    assert width <= high[1] - low[1] < width + 0.4  # mirrors
    assert abs(low[2]) < 0.02


@pytest.mark.parametrize("kind", CARS)
@pytest.mark.parametrize("end", ["front", "rear"])
def test_no_beam_enters_below_the_edge_of_the_roof(kind, end):
    """A level one, in the car's middle, half a centimetre lower than where its roof begins."""
    shape = CARS[kind]
    share, along, ahead = (shape.roof_front, 0.0, 1.0) if end == "front" else (shape.roof_rear, 1.0, -1.0)
    edge = shape.height_m - 0.05 * (2 * along - 0.7) ** 2
    found = SurfaceCaster(car_soup(shape)).ranges(np.array([[20.0 * ahead, 0, edge - 0.005]]), np.array([[-ahead, 0, 0]]))
    assert 20.0 - found[0] == pytest.approx(ahead * shape.length_m * (0.5 - share), abs=0.01)
