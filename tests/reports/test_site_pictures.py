from dataclasses import replace

import numpy as np
import pytest
from reports_toys import circles_of, result

from hilbertvae.drawing.canvas import pixels, save_picture
from hilbertvae.gaps import Gaps
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reports.site_pictures import ZOOMED, SiteMaps, contact_sheet, gap_zoom_picture, gaps_of, site_map_picture
from toy_places import room


@pytest.fixture(scope="module")
def maps():
    site = room()
    gaps = Gaps(np.array([[2.0, 0.5], [9.7, 4.0], [5.0, 3.0]]), np.array([0.8, 0.6, 0.5]), site.resolution_m)
    shown = gaps.cut(site.fit)
    mappers = {"nearest": NearestMapper(1), "nearest-15": NearestMapper(15)}
    return SiteMaps.draw(site, gaps, shown, {name: mapper.fit(shown.points, shown.occupied) for name, mapper in mappers.items()})


def test_what_mappers_are_given_has_gaps_and_the_truth_has_not(maps):
    x, y = maps.raster.queries().T
    for centre, radius in zip(maps.gaps.centres, maps.gaps.radius_m, strict=True):
        inside = maps.raster.image(np.hypot(x - centre[0], y - centre[1]) < radius - 0.15)
        assert not maps.shown[inside].any()
        assert maps.truth[inside].any()
    assert maps.hidden[2] == 0 and maps.hidden[:2].min() > 5  # the last is in the middle of the room


def test_site_map_outlines_every_gap_in_every_panel(maps):
    figure = site_map_picture(maps)
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in panels][0] == "room, before"
    assert [axes.get_title(loc="left") for axes in panels][2:] == ["nearest", "nearest-15"]
    for axes in panels:
        assert [tuple(circle.center) for circle in circles_of(axes)] == [tuple(centre) for centre in maps.gaps.centres]
        assert [circle.radius for circle in circles_of(axes)] == maps.gaps.radius_m.tolist()
        assert axes.images[0].origin == "lower"
    np.testing.assert_array_equal(panels[2].images[0].get_array(), maps.maps["nearest"])
    np.testing.assert_allclose(panels[2].images[0].get_extent(), maps.raster.extent)
    assert panels[2].images[0].get_clim() == (0, 1)


def test_zooms_stand_around_their_gaps(maps):
    figure = gap_zoom_picture(maps)
    chosen = maps.telling(ZOOMED)
    panels = [axes for axes in figure.axes if axes.images and circles_of(axes)]
    assert len(panels) == 3 * len(chosen)
    for axes, gap in zip(panels, chosen * 3, strict=True):
        assert np.mean(axes.get_xlim()) == pytest.approx(maps.gaps.centres[gap, 0])
        assert np.mean(axes.get_ylim()) == pytest.approx(maps.gaps.centres[gap, 1])
        assert np.ptp(axes.get_xlim()) == pytest.approx(4 * maps.gaps.radius_m[gap])
        left, right, bottom, top = axes.images[0].get_extent()  # no white paper, which would look free
        assert left <= axes.get_xlim()[0] and right >= axes.get_xlim()[1] and bottom <= axes.get_ylim()[0] and top >= axes.get_ylim()[1]


def test_telling_goes_from_the_fullest_gap_to_the_middle_one(maps):
    many = SiteMaps(maps.name, maps.raster, maps.gaps, np.array([3, 50, 0, 40, 10, 30, 20]), maps.truth, maps.shown, {})
    assert many.telling(3) == [1, 5, 6]
    assert many.telling(100) == [1, 3, 5, 6]


def test_contact_sheet_names_and_roles():
    figure = contact_sheet([(room(name="a"), "train"), (room(3, name="b"), "test"), (room(name="c"), "train")], columns=2)
    titled = [(axes.get_title(loc="left"), axes.get_title(loc="right")) for axes in figure.axes if axes.get_visible()]
    assert titled == [("a", "train"), ("b", "test"), ("c", "train")]
    for axes in figure.axes[:3]:
        left, right, bottom, top = axes.images[0].get_extent()
        assert right - left == pytest.approx(top - bottom)
        assert left < 0 < 10 < right and bottom < 0 < 6 < top


@pytest.mark.parametrize(("dimension", "said"), [(2, ""), (3, "3D sites: slices 1 m above the median ground")])
def test_a_contact_sheet_says_that_3d_sites_are_slices(dimension, said):
    figure = contact_sheet([(room(dimension, sweeps=2), "test")])
    assert figure.get_suptitle() == said
    image = pixels(figure)
    assert all((edge == 255).all() for edge in (image[0], image[-1], image[:, 0], image[:, -1]))


@pytest.mark.parametrize("count", range(1, 9))
def test_no_title_of_a_contact_sheet_is_cut_off(count):
    image = pixels(contact_sheet([(room(sweeps=2, beams=200, name="simulated:900001"), "validate")] * count))
    assert all((edge == 255).all() for edge in (image[0], image[-1], image[:, 0], image[:, -1]))


def test_gaps_of_a_result_and_a_saved_picture(maps, tmp_path):
    gaps = gaps_of(result(), room(), seed=2)
    assert gaps.centres.tolist() == [[3.0, 2.0]] and gaps.radius_m.tolist() == [1.25] and gaps.resolution_m == 0.1
    path = tmp_path / "new" / "zoom.png"
    save_picture(gap_zoom_picture(maps), path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in path.parent.iterdir()] == ["zoom.png"]


def test_a_site_s_name_is_no_formula(maps):
    name = "drive_$1_$2"
    contact_sheet([(room(name=name), "test")]).draw_without_rendering()
    site_map_picture(replace(maps, name=name)).draw_without_rendering()
