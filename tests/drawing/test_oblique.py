import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib import colormaps
from matplotlib.colors import ListedColormap

from hilbertvae.drawing.oblique import CREASE_PX, CREASES, Camera, _creases, render_voxels, visible


def first_by_brute_force(centres, camera, resolution_m):
    """Each pixel's ray against every cube, one at a time."""
    right, up, forward = camera.axes
    forward = np.where(np.abs(forward) < 1e-9, 1e-9, forward)  # along a side
    width, height = camera.pixels
    image = np.full((height, width), -1)
    for row in range(height):
        for column in range(width):
            start = camera.centre + right * (column + 0.5 - width / 2) * camera.pixel_m - up * (row + 0.5 - height / 2) * camera.pixel_m
            near, far = ((centres + side * np.sign(forward) * resolution_m / 2 - start) / forward for side in (-1, 1))
            enter, leave = near.max(axis=1), far.min(axis=1)
            if (enter <= leave).any():
                image[row, column] = np.argmin(np.where(enter <= leave, enter, np.inf))
    return image


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0, 360), st.floats(5, 85), st.floats(0.03, 0.8))
def test_the_nearest_voxel_of_each_ray_is_shown(seed, azimuth, elevation, pixel_m):
    rng = np.random.default_rng(seed)
    centres = np.unique(rng.integers(-4, 4, (60, 3)), axis=0) * 0.2 + 0.1
    camera = Camera(rng.uniform(-0.3, 0.3, 3), azimuth, elevation, pixel_m, (24, 18))
    expected, found = first_by_brute_force(centres, camera, 0.2), visible(centres, camera, 0.2)
    assert (expected != found).mean() <= 0.01  # rays through an edge, by rounding


def test_picture_has_x_to_the_right_and_z_up_seen_along_y():
    camera = Camera(np.zeros(3), 90.0, 0.0, 0.1, (40, 20))
    column, row, depth = camera.project(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 2.0, 0.0]])).T
    np.testing.assert_allclose(column, [30, 20, 20], atol=1e-9)
    np.testing.assert_allclose(row, [10, 5, 10], atol=1e-9)
    np.testing.assert_allclose(depth, [0, 0, 2], atol=1e-9)


@given(st.floats(0, 360), st.floats(0, 90))
@settings(max_examples=20)
def test_a_camera_around_points_shows_them_all(azimuth, elevation):
    points = np.random.default_rng(0).uniform([500_000, 0, 0], [500_100, 20, 5], (100, 3))
    camera = Camera.around(points, azimuth, elevation, (300, 200))
    column, row, _ = camera.project(points).T
    assert column.min() >= 0 and column.max() <= 300 and row.min() >= 0 and row.max() <= 200
    assert np.ptp(column) > 0.9 * 300 or np.ptp(row) > 0.9 * 200


def test_colours_tint_and_background():
    points = np.array([[0.1, 0.1, 0.1], [1.1, 0.1, 0.1], [2.1, 0.1, 0.1]])
    camera = Camera.around(points, 90.0, 60.0, (160, 60), margin=0.2)
    colours = ListedColormap([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
    image = render_voxels(points, np.array([0.0, 1.0, 0.0]), camera, 0.2, colours, tinted=np.array([False, False, True]), tint="#00ff00")
    assert image.dtype == np.uint8 and image.shape == (60, 160, 3)
    assert (image[0, 0] == 255).all()
    places = np.floor(camera.project(points)[:, 1::-1]).astype(int)
    assert [int(image[row, column].argmax()) for row, column in places] == [2, 0, 1]


def test_faces_of_a_box_differ_and_creases_are_darker():
    plane = np.argwhere(np.ones((30, 30, 1)))
    box = np.argwhere(np.ones((8, 8, 6))) + [11, 11, 1]
    points = (np.concatenate([plane, box]) + 0.5) * 0.2
    camera = Camera.around(points, 60.0, 35.0, (300, 200))
    image = render_voxels(points, np.ones(len(points)), camera, 0.2, ListedColormap(["white"])).astype(int)
    seen = visible(points, camera, 0.2)
    top = image[(seen >= 900) & (points[np.maximum(seen, 0), 2] > 1.2)].mean()
    side = image[(seen >= 900) & (points[np.maximum(seen, 0), 2] < 1.0)].mean()
    assert top > 1.15 * side
    far = np.hypot(*(points[:900, :2] - 3.0).T) > 2.8
    floor = (seen >= 0) & (seen < 900)
    foot = floor & np.isin(seen, np.flatnonzero((np.abs(points[:900, :2] - [3.0, 2.1]) < [0.5, 0.15]).all(axis=1)))
    assert image[foot].mean() < image[floor & np.isin(seen, np.flatnonzero(far))].mean()


def creases_by_brute_force(depth, resolution_m):
    """Pixel by pixel; beyond the picture's side its last pixel goes on."""
    factors = np.ones(depth.shape)
    for row, column in np.argwhere(np.isfinite(depth)):
        shade = 0.0
        for reach in CREASE_PX:
            for down, aside in ((0, reach), (reach, 0), (reach, reach), (reach, -reach)):
                deeper = 0.0
                for sign in (1, -1):
                    there = np.clip([row + sign * down, column + sign * aside], 0, np.array(depth.shape) - 1)
                    if np.isfinite(depth[tuple(there)]):
                        deeper += np.clip(depth[row, column] - depth[tuple(there)], -4 * resolution_m, 4 * resolution_m)
                shade += max(deeper, 0)
        factors[row, column] = np.exp(-CREASES * shade / resolution_m)
    return factors


@pytest.mark.parametrize("rows", [5, 19])
def test_creases_are_those_of_each_pixel_by_itself(rows, monkeypatch):
    monkeypatch.setattr("hilbertvae.drawing.oblique.ROWS_AT_ONCE", 8)
    rng = np.random.default_rng(rows)
    depth = np.where(rng.random((rows, 17)) < 0.8, rng.normal(0, 0.5, (rows, 17)), np.inf).astype(np.float32)
    hit = np.isfinite(depth)
    np.testing.assert_allclose(_creases(depth, 0.2)[hit], creases_by_brute_force(depth, 0.2)[hit], rtol=1e-5)


def test_no_voxels_is_white_and_off_picture_is_left_out():
    camera = Camera(np.zeros(3), 0.0, 45.0, 0.1, (20, 10))
    assert (render_voxels(np.empty((0, 3)), np.empty(0), camera, 0.2, colormaps["viridis"]) == 255).all()
    assert (render_voxels(np.array([[0.0, 50.0, 0.0]]), np.ones(1), camera, 0.2, colormaps["viridis"]) == 255).all()


@pytest.mark.parametrize("elevation", [0.0, 90.0])
def test_level_and_straight_down(elevation):
    points = (np.argwhere(np.ones((4, 4, 4))) + 0.5) * 0.2
    camera = Camera.around(points, 0.0, elevation, (50, 50))
    seen = visible(points, camera, 0.2)
    assert len(np.unique(seen[seen >= 0])) == 16
