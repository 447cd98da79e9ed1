from dataclasses import replace

import numpy as np
import pytest
from reports_toys import circles_of

from hilbertvae.drawing import oblique
from hilbertvae.drawing.canvas import pixels
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reports import surface_pictures
from hilbertvae.reports.site_view import SiteView
from hilbertvae.reports.surface_pictures import close_up_picture, site_view_picture
from toy_places import street, street_gaps


@pytest.fixture(scope="module")
def view():
    site, gaps = street(), street_gaps()
    shown = gaps.cut(site.fit)
    near, wide = (NearestMapper(count).fit(shown.points, shown.occupied) for count in (1, 3))
    return SiteView.draw(site, gaps, shown, near, wide)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Large enough to be drawn, small enough to be quick."""
    monkeypatch.setattr(oblique, "WHOLE_PX", 400)
    monkeypatch.setattr(surface_pictures, "CLOSE_UP_PX", (240, 200))


def test_site_view_outlines_every_gap(view):
    figure = site_view_picture(view)
    panels = [axes for axes in figure.axes if axes.images]
    assert len(panels) == 4
    assert [circle.radius for circle in circles_of(panels[0])] == view.gaps.radius_m.tolist()
    assert panels[0].get_title(loc="left") == "street, shown: 3 gaps cut"
    sizes = {axes.images[0].get_array().shape for axes in panels}
    assert len(sizes) == 1
    assert pixels(figure).std() > 5


def test_close_ups_share_a_view_in_each_row(view):
    figure = close_up_picture(view)
    panels = [axes for axes in figure.axes if axes.images]
    assert len(panels) == 4 * 2
    assert [axes.get_title(loc="right") for axes in panels[:4]] == ["shown", "truth", "map", "map, calibrated for points"]
    assert panels[0].get_title(loc="left").startswith("gap 1: as large as a car")
    for line in (panels[:4], panels[4:]):
        (centre,) = {tuple(circle.center) for axes in line for circle in circles_of(axes)}
        left, right = line[0].get_xlim()
        assert left < centre[0] < right
        shown, truth, *_ = (np.asarray(axes.images[0].get_array()).astype(int) for axes in line)
        assert (shown != truth).any()
        assert (truth[..., 0] > truth[..., 2] + 60).any()  # the tint's orange: all else is grey or blue


def test_close_ups_of_chosen_gaps(view):
    figure = close_up_picture(view, {2: "bare ground"})
    assert figure.axes[0].get_title(loc="left") == "gap 3: bare ground"


def test_close_ups_of_one_map_alone(view):
    figure = close_up_picture(replace(view, for_points=None), {2: "bare ground"})
    assert [axes.get_title(loc="right") for axes in figure.axes if axes.images] == ["shown", "truth", "map"]


def test_a_site_s_name_is_no_formula(view):
    site_view_picture(replace(view, name="drive_$1_$2")).draw_without_rendering()
