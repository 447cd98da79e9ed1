"""Scans that lie on their side are told of, and others are not."""

import warnings

import numpy as np
import pytest

from hilbertvae.commands.map import main as map_scans
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.upright import BLOCK_M, FACING, LEAST_RETURNS, THIN, WIDE, facing_axes, warn_of_lying
from hilbertvae.site import SiteSource

TO_CAMERA = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""x to the right, y down, z ahead."""


def street(seed=0, scans=3, ground=40_000, fronts=12_000, step_m=4.0):
    """Ground and two house fronts, seen from a car on the way along x."""
    rng = np.random.default_rng(seed)
    parts, origins = [], []
    for number in range(scans):
        x = step_m * number
        flat = np.column_stack([rng.uniform(x - 10, x + 10, ground), rng.uniform(-6, 6, ground), rng.normal(0.25, 0.02, ground)])
        fronted = np.column_stack(
            [
                rng.uniform(x - 10, x + 10, fronts),
                rng.choice([-6.25, 6.25], fronts) + rng.normal(0, 0.02, fronts),
                rng.uniform(0, 4, fronts),
            ]
        )
        parts.append(np.vstack([flat, fronted]))
        origins.append(np.broadcast_to([x, 0.0, 1.7], parts[-1].shape))
    sizes = [len(part) for part in parts]
    beam = np.concatenate([np.arange(size) for size in sizes])
    return Scans(np.vstack(parts), np.vstack(origins), np.repeat(np.arange(scans), sizes), beam)


def turned(scans, turn=TO_CAMERA):
    return Scans(scans.points @ turn.T, scans.origins @ turn.T, scans.scan, scans.beam)


def told(scans):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        warn_of_lying(scans, "a")
    return [str(each.message) for each in found]


@pytest.mark.parametrize("scans", [1, 2, 3])
def test_of_a_street_in_the_frame_of_a_camera_and_of_it_alone(scans):
    assert told(street(scans=scans)) == []
    (said,) = told(turned(street(scans=scans)))
    assert said.startswith("a: z is to be up, and ") and "face along y and 0% along z: are poses in the frame of a camera?" in said


def test_who_drives_along_a_wall_is_not_lying():
    """Of a wall alone, as of a front that a scanner looks at, nobody knows; along it a robot goes, and not up."""
    wall = {"ground": 0, "fronts": 20_000}
    assert told(street(scans=3, **wall)) == []
    assert told(street(scans=1, **wall)) != []


def test_few_surfaces_say_nothing():
    assert told(turned(street(scans=1, ground=600, fronts=200))) == []
    assert told(Scans(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, int), np.empty(0, int))) == []
    flat = street()
    assert told(Scans(flat.points[:, :2], flat.origins[:, :2], flat.scan, flat.beam)) == []


def test_surfaces_are_those_that_a_loop_finds():
    rng = np.random.default_rng(3)
    near = street(1, scans=1).points
    near = near[np.abs(near[:, 0]) < 3]
    points = np.vstack([near, rng.uniform(-2, 2, (4000, 3)), np.outer(rng.uniform(0, 5, 300), [1.0, 0.3, 0.2])])
    expected = []
    for cube in sorted({tuple(each) for each in np.floor(points / BLOCK_M)}):
        inside = points[(np.floor(points / BLOCK_M) == cube).all(axis=1)]
        if len(inside) < LEAST_RETURNS:
            continue
        _, spread, axes = np.linalg.svd(inside - inside.mean(axis=0))
        variances = spread**2 / len(inside)
        if variances[2] < THIN * variances[1] and variances[1] > WIDE * variances[0]:
            expected.append(np.abs(axes[2]) > FACING)
    np.testing.assert_array_equal(facing_axes(points), expected)
    assert len(expected) > 100 and 0 < np.sum(expected) < len(expected)


def test_a_map_s_user_and_a_training_s_are_told(tmp_path, capsys):
    scans, path = turned(street()), tmp_path / "camera.npz"
    np.savez(path, points=scans.points, origins=scans.origins, scan=scans.scan)
    with pytest.warns(UserWarning, match="camera.npz: z is to be up"):
        SiteSource(dimension=3).scans(str(path))
    assert map_scans([f"scans={path}", f"output={tmp_path / 'out'}", "fill=off", "exports=[npz]"]) == 0
    assert "camera.npz: z is to be up" in capsys.readouterr().err


def test_no_real_site_lies_and_drives_that_are_turned_do(real_sites):
    drives = {"kitti00_start", "kitti_drive0005", "nuscenes_train"}
    for name in [name for name in real_sites if name in drives or name.startswith("single_")]:
        found = SiteSource(folder=str(next(iter(real_sites.values())).parents[1])).scans(name)
        if found.dimension == 3:
            assert told(found) == []
            assert name not in drives or told(turned(found))
