"""Triangle soups."""

import numpy as np
import pytest

from hilbertvae.simulate.soup import Surface, boxes_3d, ellipsoids, facets, joined, quads, sheet, tubes


def test_a_box_has_its_size_and_stands_on_its_foot():
    box = boxes_3d([1, 2, 3], [4, 2, 1], np.pi / 2)
    np.testing.assert_allclose(box.triangles.min(axis=(0, 1)), [0, 0, 3], atol=1e-12)
    np.testing.assert_allclose(box.triangles.max(axis=(0, 1)), [2, 4, 4])
    assert area(box) == pytest.approx(2 * (4 * 2 + 4 * 1 + 2 * 1))


def area(soup):
    a, b, c = np.moveaxis(soup.triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_a_tube_has_about_the_area_of_a_cylinder():
    assert area(tubes([[0, 0, 0]], [[0, 0, 3.0]], 0.5, 0.5, 64)) == pytest.approx(2 * np.pi * 0.5 * 3, rel=0.01)
    assert area(tubes([[0, 0, 0]], [[1.0, 1.0, 0]], 0.5, 0.0, 64, caps=True)) == pytest.approx(np.pi * (0.5 * 1.5 + 0.25), rel=0.01)


def test_an_ellipsoid_stays_within_its_half_axes():
    soup = ellipsoids([[1, 0, 0]], [[1, 2, 3]])
    np.testing.assert_allclose(np.abs(soup.triangles - [1, 0, 0]).max(axis=(0, 1)), [1, 2, 3], rtol=0.1)


def test_surfaces_stay_with_their_triangles():
    grid = np.stack(np.meshgrid(np.arange(3.0), np.arange(2.0), [0.0], indexing="ij"), -1)[:, :, 0]
    both = joined([sheet(grid, np.array([[Surface.GLASS], [Surface.PAINT]])), quads(np.zeros((1, 4, 3)), Surface.NET), joined([])])
    assert both.surface.tolist() == [Surface.GLASS] * 2 + [Surface.PAINT] * 2 + [Surface.NET] * 2


def test_facets_lie_around_their_places():
    middles = np.random.default_rng(0).normal(size=(50, 3))
    soup = facets(np.random.default_rng(1), middles, 0.2, outward=middles)
    np.testing.assert_allclose(soup.triangles.mean(axis=1), middles, atol=0.1)
    assert np.linalg.norm(soup.triangles - middles[:, None], axis=2).max() < 0.35


def test_moving_turns_about_the_vertical_then_shifts():
    moved = quads([[[1, 0, 0]] * 4], Surface.WALL).moved([5, 5, 1], np.pi / 2)
    np.testing.assert_allclose(moved.triangles[0, 0], [5, 6, 1], atol=1e-12)
