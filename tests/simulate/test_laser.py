"""The ray caster against a brute-force twin, and what the laser makes of ranges."""

import builtins

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.simulate.laser import LaserSettings, RayCaster, bearings, extrude, sense, sim_extra

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.simulate.floor_plan import draw_floor_plan  # noqa: E402
from hilbertvae.simulate.shapes import box, edges  # noqa: E402

EXACT = LaserSettings(range_noise_m=0, range_step_m=0, miss_share=0, edge_mix_share=0, glass_return_share=0, glass_pass_share=0)


def brute_force_ranges(segments, origins, directions):
    """Each ray against each segment: o + t d = a + u (b - a)."""
    ranges = np.full(len(origins), np.inf)
    for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        for start, end in segments:
            along = end - start
            determinant = along[0] * direction[1] - along[1] * direction[0]
            if abs(determinant) < 1e-12:
                continue
            gap = start - origin
            t = (along[0] * gap[1] - along[1] * gap[0]) / determinant
            u = (direction[0] * gap[1] - direction[1] * gap[0]) / determinant
            if t >= 0 and 0 <= u <= 1:
                ranges[k] = min(ranges[k], t)
    return ranges


def fan(origin, settings):
    angles = bearings(settings)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[None]
    return np.broadcast_to(np.asarray(origin, dtype=float), directions.shape), directions


def room_with_pane():
    """A room of 10 x 6 m around the origin, a pane at x = 2 and a pillar behind it."""
    walls = shapely.box(-5.2, -3.2, 5.2, 3.2) - shapely.box(-5, -3, 5, 3)
    solid = RayCaster(*extrude(edges([walls, box([4, 0], 0.0, 0.5, 0.5)])))
    return solid, RayCaster(*extrude(edges([box([2, 0], 0.0, 0.02, 4.0)])))


@pytest.mark.parametrize("seed", range(3))
def test_ranges_equal_brute_force_on_a_random_plan(seed):
    rng = np.random.default_rng(seed)
    plan = draw_floor_plan(rng, 12.0, ["corridors", "hall", "enfilade"][seed])
    segments = edges(plan.solids)
    low, high = segments.reshape(-1, 2).min(axis=0), segments.reshape(-1, 2).max(axis=0)
    origins, angles = rng.uniform(low, high, (150, 2)), rng.uniform(0, 2 * np.pi, 150)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    found = RayCaster(*extrude(segments)).ranges(origins, directions)
    expected = brute_force_ranges(segments, origins, directions)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert np.isfinite(found).mean() > 0.2  # plans with windows have much outdoors around them


def test_rays_in_three_dimensions_meet_walls_only_below_their_top():
    caster = RayCaster(*extrude(np.array([[[3.0, -1.0], [3.0, 1.0]]]), bottom_m=0.0, top_m=2.0))
    level, steep = np.array([1.0, 0.0, 0.0]), np.array([3.0, 0.0, 4.0]) / 5
    ranges = caster.ranges(np.array([[0, 0, 1.0], [0, 0, 2.5], [0, 0, -3.0]]), np.array([level, level, steep]))
    np.testing.assert_allclose(ranges, [3.0, np.inf, 5.0])


def test_an_empty_mesh_is_never_hit():
    assert np.isinf(RayCaster(*extrude(np.empty((0, 2, 2)))).ranges(np.zeros((3, 2)), np.eye(2)[[0, 1, 0]])).all()


def test_glass_returns_nothing_and_what_is_beside_it_does():
    solid, glass = room_with_pane()
    ranges = sense(np.random.default_rng(0), EXACT, solid, glass, *fan([0, 0], EXACT))[0]
    at_pane = np.abs(np.tan(bearings(EXACT))) < 0.99
    assert np.isnan(ranges[at_pane]).all()
    np.testing.assert_allclose(ranges[0], 3.0)


def test_glass_lets_beams_pass_to_what_is_behind():
    solid, glass = room_with_pane()
    settings = LaserSettings(**{**vars(EXACT), "glass_pass_share": 1.0})
    ranges = sense(np.random.default_rng(0), settings, solid, glass, *fan([0, 0], settings))[0]
    np.testing.assert_allclose(ranges[settings.beams // 2], 3.75)
    assert np.isfinite(ranges).all()


def test_what_moves_hides_what_is_behind_it():
    solid, glass = room_with_pane()
    ranges = sense(np.random.default_rng(0), EXACT, solid, glass, *fan([0, 0], EXACT), moving=np.full((1, EXACT.beams), 1.0))
    np.testing.assert_allclose(ranges, 1.0)


def test_nothing_is_returned_from_the_longest_range_on():
    solid, glass = room_with_pane()
    settings = LaserSettings(max_range_m=3.5, glass_pass_share=0.97, glass_return_share=0.03, range_noise_m=0.05)
    ranges = sense(np.random.default_rng(0), settings, solid, glass, *fan([0, 0], settings))
    assert np.isnan(ranges).any() and np.nanmax(ranges) < 3.5


def answers(seen_m, **faults):
    """What a laser with these faults alone reports of ranges (S, B): nothing stands around but what moves."""
    nothing = RayCaster(*extrude(np.empty((0, 2, 2))))
    beams = np.zeros((*np.shape(seen_m), 2)), np.ones((*np.shape(seen_m), 2))
    return sense(np.random.default_rng(1), LaserSettings(**{**vars(EXACT), **faults}), nothing, nothing, *beams, moving=seen_m)


def test_ranges_spread_by_their_noise_around_the_truth():
    errors = answers(np.full((200, 180), 5.0), range_noise_m=0.02) - 5.0
    assert errors.std() == pytest.approx(0.02, rel=0.03) and abs(errors.mean()) < 0.001


def test_ranges_come_in_whole_steps():
    steps = answers(np.full((20, 180), 5.0), range_noise_m=0.02, range_step_m=0.01) / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(steps.round())) > 5


def test_as_many_beams_are_lost_as_asked_for():
    assert np.isnan(answers(np.full((200, 180), 5.0), miss_share=0.1)).mean() == pytest.approx(0.1, abs=0.006)


@pytest.mark.parametrize(("jump_m", "share"), [(0.5, 0.3), (0.05, 0.0), (2.0, 0.0)])
def test_beams_at_small_edges_mix_both_depths(jump_m, share):
    """Every other beam meets what lies `jump_m` deeper. All beams but the first have a neighbour before them."""
    seen = np.full((200, 181), 5.0)
    seen[:, 1::2] += jump_m
    found = answers(seen, edge_mix_share=0.3)
    mixed = (found != seen)[:, 1:]
    assert mixed.mean() == pytest.approx(share, abs=0.01)
    assert not mixed.any() or (5.0 < found[:, 1:][mixed].min() < 5.1 and 5.4 < found[:, 1:][mixed].max() < 5.5)


@pytest.mark.parametrize("beams", [60, 180, 360])
def test_slanted_walls_and_corners_are_no_edges(beams):
    """A corridor of 40 x 1 m: neighbouring beams differ by up to metres, and nothing stands before anything else."""
    solid, glass = RayCaster(*extrude(edges([shapely.box(-1, -0.4, 39, 0.6)]))), RayCaster(*extrude(np.empty((0, 2, 2))))
    settings = LaserSettings(**{**vars(EXACT), "beams": beams, "max_range_m": 50.0})
    origins, directions = fan([0, 0], settings)
    truth = sense(np.random.default_rng(0), settings, solid, glass, origins, directions)
    found = sense(np.random.default_rng(0), LaserSettings(**{**vars(settings), "edge_mix_share": 1.0}), solid, glass, origins, directions)
    jump = np.abs(np.diff(truth))
    assert ((jump > 0.1) & (jump < 1.5)).sum() >= 4
    np.testing.assert_array_equal(found, truth)


def test_empty_rooms_have_no_edges():
    """Rooms of any shape from any place: corners between two beams, walls that a single beam meets before the next one."""
    rng, glass = np.random.default_rng(0), RayCaster(*extrude(np.empty((0, 2, 2))))
    settings = LaserSettings(**{**vars(EXACT), "beams": 360, "max_range_m": 60.0})
    jumps = 0
    for _ in range(30):
        ends = rng.uniform(0.3, 20.0, 4)
        solid = RayCaster(*extrude(edges([shapely.box(-ends[0], -ends[1], ends[2], ends[3])])))
        origins, directions = fan([0, 0], settings)
        turn = rng.uniform(0, 2 * np.pi)
        directions = (
            directions
            @ np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])[
                : directions.shape[-1], : directions.shape[-1]
            ]
        )
        truth = sense(np.random.default_rng(0), settings, solid, glass, origins, directions)
        found = sense(
            np.random.default_rng(0), LaserSettings(**{**vars(settings), "edge_mix_share": 1.0}), solid, glass, origins, directions
        )
        jumps += (np.abs(np.diff(truth)) > 0.1).sum()
        np.testing.assert_array_equal(found[:, 2:-2], truth[:, 2:-2])  # a fan's ends have no two beams beyond a corner
    assert jumps > 500


@pytest.mark.parametrize(
    ("seen", "mixes"),
    [
        ([5, 5, 5.5, 5.5], [2]),
        ([np.inf, 5, 5.5, 5.5], [2]),  # one side of a single beam: the other alone decides
        ([5, 5, 5.5, np.inf], [2]),
        ([np.inf, 5, 5.5, np.inf], [2]),
        ([5, 5, np.inf, 5.5, 5.5], []),
        ([5, 5, 5, 5.5, 5, 5, 5], [3, 4]),  # something narrow
    ],
)
def test_edges_between_what_is_seen_mix_and_no_others(seen, mixes):
    seen = np.tile(np.asarray(seen, dtype=float), (20, 1))
    found = answers(seen, edge_mix_share=1.0)
    changed = np.isfinite(seen) & (found != seen)
    assert [k for k in range(seen.shape[1]) if changed[:, k].any()] == mixes and changed[:, mixes].all()


def test_panes_return_their_share_of_beams():
    solid, glass = room_with_pane()
    settings = LaserSettings(**{**vars(EXACT), "glass_return_share": 0.3, "glass_pass_share": 0.5})
    origins, directions = fan([0, 0], settings)
    fate = sense(np.random.default_rng(0), settings, solid, glass, np.repeat(origins, 300, axis=0), np.repeat(directions, 300, axis=0))
    ahead = fate[:, settings.beams // 2 - 5 : settings.beams // 2 + 6]
    on_pane = np.abs(ahead * np.cos(bearings(settings)[settings.beams // 2 - 5 : settings.beams // 2 + 6]) - 1.99) < 1e-6
    assert on_pane.mean() == pytest.approx(0.3, abs=0.03)
    assert np.isnan(ahead).mean() == pytest.approx(0.2, abs=0.03)


def test_bearings_are_those_of_carmen_logs():
    np.testing.assert_allclose(np.rad2deg(bearings(LaserSettings(beams=360)))[[0, 1, -1]], [-90, -89.5, 89.5])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"beams": 0}, "laser.beams: expected a whole number of at least 1"),
        ({"beams": 1.5}, "laser.beams: expected a whole number of at least 1"),
        ({"max_range_m": -1.0}, "laser.max_range_m: expected a positive number"),
        ({"field_of_view_deg": 400.0}, "laser.field_of_view_deg: expected at most 360"),
        ({"range_noise_m": float("nan")}, "laser.range_noise_m: expected a number from 0 on"),
        ({"miss_share": 1.2}, r"laser.miss_share: expected a share in \[0, 1\]"),
        ({"glass_pass_share": 0.99}, "expected at most 1 together"),
    ],
)
def test_bad_settings_are_named(setting, message):
    with pytest.raises(InputError, match=message):
        LaserSettings(**setting)


def test_a_missing_extra_is_named(monkeypatch):
    real_import = builtins.__import__

    def without_embree(name, *rest, **named):
        if name.startswith("embreex"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real_import(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", without_embree)
    monkeypatch.delitem(__import__("sys").modules, "trimesh.ray.ray_pyembree", raising=False)
    with pytest.raises(InputError, match=r"pip install 'hilbertvae\[sim\]'"):
        sim_extra("trimesh.ray.ray_pyembree")
