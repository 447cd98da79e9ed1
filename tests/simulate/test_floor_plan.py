"""Floor plans: what stands where, and doors that join floors."""

import numpy as np
import pytest

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.simulate import floor_plan, furniture, openings  # noqa: E402
from hilbertvae.simulate.floor_plan import draw_floor_plan  # noqa: E402
from hilbertvae.simulate.free_space import find_free_space, inside  # noqa: E402
from hilbertvae.simulate.layouts import LAYOUTS, Sketch  # noqa: E402
from hilbertvae.simulate.shapes import edges  # noqa: E402


@pytest.mark.parametrize("style", LAYOUTS)
def test_plans_are_the_same_for_the_same_seed_and_differ_otherwise(style):
    first, again, other = (draw_floor_plan(np.random.default_rng(seed), 30.0, style) for seed in (0, 0, 1))
    assert shapely.to_wkb(first.solids).tolist() == shapely.to_wkb(again.solids).tolist()
    assert shapely.to_wkb(first.solids).tolist() != shapely.to_wkb(other.solids).tolist()


def test_rooms_keep_a_walls_thickness_apart():
    sketch = Sketch(wall_m=0.2, outer_wall_m=0.3)
    sketch.add(shapely.box(0, 0, 5, 4), "room")
    sketch.add(shapely.box(4, 0, 9, 4), "room")
    first, second = (floor.polygon for floor in sketch.floors)
    assert first.distance(second) == pytest.approx(0.2, abs=2e-3)


def test_some_plans_have_glass():
    assert any(len(draw_floor_plan(np.random.default_rng(seed), 30.0, "corridors").glass) for seed in range(8))


def test_every_part_of_a_building_has_windows(monkeypatch):
    def two_halls(rng, sketch, extent_m):
        sketch.add(shapely.box(0, 0, 10, 8), "hall")
        sketch.add(shapely.box(40, 0, 50, 8), "hall")

    monkeypatch.setitem(LAYOUTS, "two halls", two_halls)
    glazed = np.zeros((0, 2), int)
    for seed in range(30):
        plan = draw_floor_plan(np.random.default_rng(seed), 15.0, "two halls")
        glazed = np.vstack([glazed, [np.sum(shapely.distance(plan.glass, hall.polygon) < 1) for hall in plan.floors[:2]]])
    assert (glazed > 0).all(axis=1).sum() >= 4


def test_windows_are_in_outer_walls(monkeypatch):
    def two_rooms(rng, sketch, extent_m):
        sketch.add(shapely.box(0, 0, 8, 8), "hall")
        sketch.add(shapely.box(8.2, 0, 16, 8), "hall")

    monkeypatch.setitem(LAYOUTS, "two rooms", two_rooms)
    monkeypatch.setattr(floor_plan, "_distort", lambda *_: None)
    panes = 0
    for seed in range(30):
        plan = draw_floor_plan(np.random.default_rng(seed), 15.0, "two rooms")
        between = shapely.convex_hull(shapely.union_all([floor.polygon for floor in plan.floors])).buffer(-0.3)
        panes += len(plan.glass)
        assert not shapely.intersects(between, plan.glass).any()
    assert panes > 5


@pytest.mark.parametrize("style", LAYOUTS)
def test_windows_near_inner_corners_open_no_other_wall(style):
    """Else a floor would be joined to outdoors, where no robot goes."""
    seeds = {"corridors": (0, 48), "hall": (6, 26), "enfilade": (21,)}  # of 70 each, which had the least free space in them
    for seed in seeds[style]:
        plan = draw_floor_plan(np.random.default_rng(seed), 25.0, style)
        space = find_free_space(plan)
        free_m2 = (space.clearance_m > 0).sum() * space.cell_m**2
        assert len(plan.glass) and free_m2 > 0.45 * shapely.union_all([floor.polygon for floor in plan.floors]).area


@pytest.mark.parametrize("style", LAYOUTS)
def test_shut_doors_stay_within_their_wall(style, monkeypatch):
    really = openings._hang_door
    monkeypatch.setattr(openings, "_hang_door", lambda *given: really(*(False if isinstance(g, bool) else g for g in given)))
    doors = shut = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        sketch = Sketch(wall_m=rng.uniform(0.1, 0.36), outer_wall_m=0.3)
        LAYOUTS[style](rng, sketch, 30.0)
        cut, leaves, _ = openings.draw_doors(rng, sketch)
        doors, shut = doors + len(cut), shut + len(leaves)
        for leaf in leaves:
            assert not any(floor.polygon.intersects(leaf.buffer(-0.0011)) for floor in sketch.floors)
    assert shut > max(50, 0.95 * doors)


@pytest.mark.parametrize("style", LAYOUTS)
def test_furniture_stays_on_floors_and_leaves_most_of_them_free(style):
    plan = draw_floor_plan(np.random.default_rng(3), 30.0, style)
    area = sum(floor.polygon.area for floor in plan.floors)
    solid = shapely.union_all(plan.solids, grid_size=1e-3)
    free = sum(shapely.make_valid(floor.polygon).difference(solid, grid_size=1e-3).area for floor in plan.floors)
    assert 0.5 * area < free <= area + 0.1


def test_furniture_leaves_free_what_lies_before_doors():
    stood = []

    def furnish(rng, floor, amount, keep_clear):
        pieces = furniture.furnish(rng, floor, furniture.CRAMMED, keep_clear)
        stood.append((pieces, keep_clear))
        return pieces

    for seed in range(3):
        draw_floor_plan(np.random.default_rng(seed), 15.0, "corridors", furnish)
    assert sum(len(pieces) for pieces, _ in stood) > 100
    for pieces, keep_clear in stood:
        assert keep_clear.area > 1.0 and not shapely.intersects(keep_clear, pieces).any()


def test_free_space_is_never_wider_than_it_is():
    plan = draw_floor_plan(np.random.default_rng(5), 20.0, "corridors")
    space = find_free_space(plan)
    rng = np.random.default_rng(0)
    points = rng.uniform(space.lower, space.lower + space.cell_m * np.array(space.clearance_m.shape[::-1]), (4000, 2))
    clearance = space.at(points)
    truth = shapely.distance(shapely.points(points), shapely.GeometryCollection(list(plan.solids)))
    assert (clearance > 0).sum() > 200
    assert (clearance <= truth + 1e-9).all()


def test_raster_equals_point_in_polygon():
    plan = draw_floor_plan(np.random.default_rng(2), 15.0, "hall")
    lower, cells, cell_m = np.array([-20.0, -20.0]), np.array([200, 190]), 0.2
    drawn = inside(edges(plan.solids), lower, cells, cell_m)
    j, i = np.indices(drawn.shape)
    centres = lower + cell_m * np.stack([i + 0.5, j + 0.5], axis=-1)
    expected = np.zeros(drawn.shape, dtype=bool)
    for solid in plan.solids:
        expected |= shapely.contains_xy(solid, centres[..., 0], centres[..., 1])
    assert drawn.any() and (drawn == expected).all()
