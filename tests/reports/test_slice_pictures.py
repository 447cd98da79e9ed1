from dataclasses import replace

import numpy as np
import pytest
from reports_toys import circles_of

from hilbertvae.reports.slice_pictures import slice_picture
from toy_places import CAR


def probability_at(axes, x, y):
    image = np.asarray(axes.images[0].get_array())
    left, right, bottom, top = axes.images[0].get_extent()
    return image[int((y - bottom) / (top - bottom) * image.shape[0]), int((x - left) / (right - left) * image.shape[1])]


def test_slices_ask_the_map_where_they_say(view):
    level, upright = slice_picture(view, 0).axes[:2]
    for x, y in ((2.0, 1.0), (8.0, 2.0), (9.3, 1.4), (5.0, 2.0), (3.5, 2.05)):
        z = 1.0 - view.ground.height_above(np.array([[x, y, 0.0]]))[0]
        voxel = (np.floor(np.array([x, y]) / 0.2) + 0.5) * 0.2
        expected = view.mapper.predict_proba(np.array([[*voxel, z]]))[0, 1]
        assert probability_at(level, x, y) == pytest.approx(expected)
    title = upright.get_title(loc="left")
    assert title == "upright along x through gap 1 (the line above)"  # along the side of the car
    for x, z in ((2.0, 1.1), (5.0, -0.1), (8.0, 3.0), (3.3, 0.7)):
        voxel = (np.floor(np.array([x, view.gaps.centres[0, 1], z]) / 0.2) + 0.5) * 0.2
        assert probability_at(upright, x, z) == pytest.approx(view.mapper.predict_proba(voxel[None])[0, 1])


def test_slices_show_observed_points_and_the_gaps_that_they_cut(view):
    level, upright = slice_picture(view, 0).axes[:2]
    dots = level.collections[0].get_offsets()
    car = ((dots > CAR[0, :2] - 0.3) & (dots < CAR[1, :2] + 0.3)).all(axis=1)
    assert car.any()
    hole = np.hypot(*(dots - view.gaps.centres[0, :2]).T) < 0.8
    assert not hole.any()
    circles = circles_of(upright)
    assert view.gaps.radius_m[0] == pytest.approx(circles[0].radius, abs=0.02)
    (circle,) = circles_of(level)  # the others lie above or below
    assert circle.center == pytest.approx(view.gaps.centres[0, :2]) and circle.radius < 1.0 + 1e-9


def test_without_a_gap_named_the_fullest_is_cut(view):
    """Of the gaps of `street_gaps`: the one in the tree."""
    assert "through gap 2 " in slice_picture(view).axes[1].get_title(loc="left")


def test_a_site_s_name_is_no_formula(view):
    slice_picture(replace(view, name="drive_$1_$2")).draw_without_rendering()
