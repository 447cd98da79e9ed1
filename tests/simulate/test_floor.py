"""Floors of buildings in space: what stands there, and what lidars return of it."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.checks import InputError  # noqa: E402
from hilbertvae.simulate import floor, interior, room_filling  # noqa: E402
from hilbertvae.simulate.ceilings import HIGH_M, draw_ceiling  # noqa: E402
from hilbertvae.simulate.floor_plan import FloorPlan  # noqa: E402
from hilbertvae.simulate.furniture import CRAMMED, PASSAGE  # noqa: E402
from hilbertvae.simulate.interior import DOOR_M, draw_interior, lid, prism  # noqa: E402
from hilbertvae.simulate.laser import RayCaster  # noqa: E402
from hilbertvae.simulate.layouts import LAYOUTS, Floor  # noqa: E402
from hilbertvae.simulate.room_filling import Piece, RoomFilling  # noqa: E402
from hilbertvae.simulate.room_furniture import AGAINST_WALLS, FREE, ON_WALLS  # noqa: E402
from hilbertvae.simulate.soup import Surface, joined  # noqa: E402
from hilbertvae.simulate.street import StreetSettings, simulate_street  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402

FLOORS = StreetSettings(variety="floors", azimuths=90, scans=3)
PIECES = sorted({draw for pieces in (*AGAINST_WALLS.values(), *FREE.values(), ON_WALLS) for draw in pieces}, key=lambda draw: draw.__name__)


def caster(soup):
    return RayCaster(soup.triangles.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))


@pytest.mark.parametrize("draw", PIECES, ids=lambda draw: draw.__name__)
def test_a_piece_stands_on_the_floor_and_is_as_large_as_furniture(draw):
    for seed in range(10):
        corners = draw(np.random.default_rng(seed)).triangles.reshape(-1, 3)
        size = np.ptp(corners, axis=0)
        assert np.isfinite(corners).all() and corners[:, 2].min() > -0.02 and corners[:, 2].max() < 5.5
        assert size.min() > 0.02 and size[:2].max() < 7.0
        if draw in ON_WALLS:
            assert corners[:, 2].min() > 0.8


WITH_BACKS = [draw for draw in PIECES if draw in ON_WALLS or any(draw in pieces for pieces in AGAINST_WALLS.values())]


@pytest.mark.parametrize("draw", WITH_BACKS, ids=lambda draw: draw.__name__)
def test_a_piece_for_walls_keeps_its_back_to_them(draw):
    for seed in range(100):
        assert draw(np.random.default_rng(seed)).triangles[..., 1].min() > -0.001


@pytest.mark.parametrize("seed", range(4))
def test_things_stand_within_walls_and_not_in_one_another(seed):
    room, door = shapely.box(0, 0, 9, 7), shapely.box(-1, 2, 1, 3.2)
    filling = RoomFilling()
    taken = filling(np.random.default_rng(seed), room, CRAMMED, door)
    assert len(taken) > 4 and taken == [piece.ground for piece in filling.pieces if piece.stands]
    assert shapely.union_all(taken).area == pytest.approx(sum(ground.area for ground in taken))
    assert not shapely.intersects(door, taken).any() and shapely.contains(room, taken).all()
    corners = np.concatenate([piece.soup.triangles.reshape(-1, 3) for piece in filling.pieces])
    assert corners[:, :2].min() > 0 and (corners[:, :2].max(axis=0) < [9, 7]).all()


def test_what_hangs_is_clear_of_what_stands_below():
    filling = RoomFilling()
    for seed in range(8):
        filling(np.random.default_rng(seed), shapely.box(0, 0, 9, 7), CRAMMED, None)
    standing, hanging = ([piece for piece in filling.pieces if piece.stands == stands] for stands in (True, False))
    assert len(hanging) > 5
    for piece in hanging:
        below = [other for other in standing if other.floor == piece.floor and other.ground.intersects(piece.ground)]
        assert all(other.top_m <= piece.soup.triangles[..., 2].min() for other in below)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_large_rooms_are_halls_or_garages(monkeypatch, share):
    monkeypatch.setattr(room_filling, "GARAGE_SHARE", share)
    filling = RoomFilling()
    for seed in range(4):
        filling(np.random.default_rng(seed), shapely.box(0, 0, 20, 14), CRAMMED, None)
    cars = [np.isin(piece.soup.surface, (Surface.GLASS, Surface.PANE)).any() for piece in filling.pieces if piece.stands]
    assert len(cars) > 8 and np.mean(cars) == share


def test_corridors_are_nearly_empty():
    assert len(RoomFilling()(np.random.default_rng(0), shapely.box(0, 0, 20, 2), PASSAGE, None)) < 12


def test_lids_cover_an_area_and_leave_holes_open():
    ring = shapely.box(0, 0, 4, 4).difference(shapely.box(1, 1, 2, 3))
    level = lid(ring, 2.5)
    assert (level.triangles[..., 2] == 2.5).all()
    flat = [shapely.Polygon(triangle[:, :2]) for triangle in level.triangles]
    assert sum(part.area for part in flat) == pytest.approx(ring.area) and shapely.union_all(flat).equals(ring)
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    met = caster(prism(ring, 1.0, 2.5)).ranges(np.array([[0.5, 0.5, 0.0], [1.5, 2.0, 0.0]]), up)
    np.testing.assert_allclose(met, [1.0, np.inf])


@pytest.mark.parametrize("style", LAYOUTS)
def test_a_floor_has_a_ceiling_walls_up_to_it_and_lintels(style):
    plan, scene = draw_interior(np.random.default_rng(3), 25.0, style)
    above = caster(scene)
    inner = [place for part in plan.floors for place in [part.polygon.buffer(-0.4).representative_point()] if not place.is_empty]
    at = np.array([[place.x, place.y, 2.19] for place in inner])
    assert len(at) and np.isfinite(above.ranges(at, np.tile([0, 0, 1.0], (len(at), 1)))).all()
    around = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8), np.zeros(16)], axis=-1)
    out = above.ranges(np.repeat(at, 16, axis=0), np.tile(around, (len(at), 1)))  # above doors, below most heads of windows
    assert np.isfinite(out).mean() > 0.9
    places = [door.representative_point() for door in plan.doorways]
    upward = above.ranges(np.array([[place.x, place.y, DOOR_M - 0.01] for place in places]), np.tile([0, 0, 1.0], (len(places), 1)))
    assert np.isclose(upward, 0.01, atol=1e-6).mean() > 0.5  # of the others, some lead through no wall


def test_below_a_windows_sill_and_above_its_head_is_wall():
    room, glass = shapely.box(0, 0, 6, 4), shapely.box(2, 4.1, 4, 4.16)
    plan = FloorPlan([Floor(room, "room")], np.array([]), np.array([]), np.array([glass]), np.array([]))
    on_ground = []
    for seed in range(20):
        window = joined(interior._windows(np.random.default_rng(seed), plan, room, top_m=2.6))
        pane = window.triangles[window.surface == Surface.PANE, :, 2]
        starts = np.array([[3.0, 2.0, height_m] for height_m in (pane.min() - 0.1, pane.mean(), pane.max() + 0.1)])
        met, surface, _ = SurfaceCaster(window).hits(starts, np.tile([0, 1.0, 0], (3, 1)))
        on_ground.append(pane.min() == 0)
        np.testing.assert_allclose(met, [np.inf if on_ground[-1] else 2.02, 2.1, 2.02])  # walls begin 8 cm before the pane
        assert surface[1:].tolist() == [Surface.PANE, Surface.WALL] and surface[0] == Surface.WALL
    assert set(on_ground) == {True, False}


@pytest.mark.parametrize("seed", range(6))
def test_things_fit_under_ceilings_and_beside_pillars(seed):
    plan, scene = draw_interior(np.random.default_rng(seed), 25.0, "hall")
    blocks, things = (plan.solids[plan.kinds == kind] for kind in ("block", "thing"))
    assert len(things) and not shapely.intersects(shapely.union_all(blocks, grid_size=1e-3), things).any()
    pillar = Piece(scene, shapely.box(0, 0, 1, 1), 0, stands=False)  # as high as the whole floor
    assert interior._fitting(plan, [pillar], [pillar.top_m + 1])[1] and not interior._fitting(plan, [pillar], [pillar.top_m - 1])[1]


def test_a_passage_is_as_high_as_what_it_joins():
    floors = [
        Floor(shapely.box(0, 0, 10, 10), "hall"),
        Floor(shapely.box(11, 0, 20, 10), "room"),
        Floor(shapely.box(9, 4, 12, 6), "corridor"),
    ]
    for seed in range(5):
        assert len(set(interior._ceilings_m(np.random.default_rng(seed), floors))) == 1
    assert any(len(set(interior._ceilings_m(np.random.default_rng(seed), floors[:2]))) == 2 for seed in range(5))


def test_high_ceilings_carry_something():
    room = shapely.box(0, 0, 8, 6)
    for seed in range(6):
        hanging = draw_ceiling(np.random.default_rng(seed), room, HIGH_M + 0.5)
        assert len(hanging) and hanging.triangles[..., 2].max() <= HIGH_M + 0.5 + 1e-9
        assert (hanging.triangles[..., :2].min() > -0.5) and (hanging.triangles[..., :2].max(axis=(0, 1)) < [8.5, 6.5]).all()


@pytest.mark.parametrize("seed", range(4))
def test_floors_are_scanned_upright_from_the_first_scan_and_the_same_again(seed):
    scans, again = simulate_street(FLOORS, seed), simulate_street(FLOORS, seed)
    assert scans.points.tobytes() == again.points.tobytes() and np.isfinite(scans.points).all()
    ranges = np.linalg.norm(scans.points - scans.origins, axis=1)
    assert len(scans) > 300 and ranges.min() > 0.4
    np.testing.assert_allclose(scans.origins[scans.scan == 0], 0, atol=1e-9)
    low = scans.points[scans.points[:, 2] < np.quantile(scans.points[:, 2], 0.02) + 0.05, 2]
    assert np.ptp(low) < 0.12  # level ground, though the sensor leans


def test_single_scans_and_drives_are_as_asked_for():
    alone = simulate_street(replace(FLOORS, single_scan_share=1.0), 5)
    assert alone.scan.max() == 0
    drive = simulate_street(replace(FLOORS, single_scan_share=0.0, shortest_step_m=1.0, longest_step_m=1.0), 5)
    middles = np.array([drive.origins[drive.scan == k].mean(axis=0) for k in range(drive.scan.max() + 1)])
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    assert 1 <= drive.scan.max() <= 2 and steps.min() > 0.6 and steps.max() < 1.2  # as the crow flies, along a way that bends


def test_every_other_site_is_a_floor_everywhere(monkeypatch):
    drawn = []
    monkeypatch.setattr(floor, "simulate_floor", lambda settings, seed: drawn.append(seed))
    monkeypatch.setattr("hilbertvae.simulate.street.scan_scene", lambda *_: None)
    monkeypatch.setattr("hilbertvae.simulate.street_filling.fill", lambda *_: MagicMock())  # a minute's work, of streets that none looks at
    monkeypatch.setattr("hilbertvae.simulate.street_filling.add_traffic", lambda *_: None)
    for seed in range(60):
        simulate_street(replace(FLOORS, variety="everywhere"), seed)
    assert 20 <= len(drawn) <= 40


def test_floors_without_a_way_are_an_error(monkeypatch):
    monkeypatch.setattr("hilbertvae.simulate.drive.drive", lambda *_: np.empty((0, 2)))
    monkeypatch.setattr(floor, "ATTEMPTS", 2)
    with pytest.raises(InputError, match="no floor that can be walked through in 2 attempts with seed 3"):
        simulate_street(FLOORS, 3)
