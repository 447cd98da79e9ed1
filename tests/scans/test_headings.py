import warnings

import numpy as np
import pytest

from hilbertvae.scans.poses import read_poses


@pytest.mark.parametrize("headings", [[0, 90, 180], [359, 0, 1, 2], [-170, -178, 174], [90]])
def test_headings_in_degrees_are_told(tmp_path, headings):
    (tmp_path / "poses.txt").write_text("".join(f"1 2 {heading}\n" for heading in headings))
    with pytest.warns(UserWarning, match=rf"poses.txt: headings in radians .* up to {max(headings, key=abs)}, .*are they degrees\?"):
        assert len(read_poses(tmp_path / "poses.txt")) == len(headings)


@pytest.mark.parametrize("headings", [np.arange(20, 40, 0.3), -np.arange(0, 700, 3), [0, 3.1, -3.1, 6.2, 0], [0, 12, -12], [0, 4000, 0]])
def test_headings_in_radians_may_wind_up(tmp_path, headings):
    (tmp_path / "poses.txt").write_text("".join(f"1 2 {heading}\n" for heading in headings))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_poses(tmp_path / "poses.txt")


def drive(path, headings, course, step_m=0.1, noise_m=0.0):
    """Poses of a robot that goes on along `course` (S,), radians, step by step."""
    rng = np.random.default_rng(0)
    places = np.cumsum(step_m * np.column_stack([np.cos(course), np.sin(course)]), axis=0) + rng.normal(0, noise_m, (len(course), 2))
    np.savetxt(path, np.column_stack([places, headings]), "%.6f")
    return path


def waves(count=400):
    """(count,) radians: a way with bends."""
    return 1.2 * np.sin(np.arange(count) / 30)


DEGREES = {
    "turning slowly": (np.arange(0, 120, 2.0), np.zeros(60)),
    "driving": (np.rad2deg(waves()), waves()),
    "a laser that looks back": (np.rad2deg(waves()) + 180, waves()),
    "round and round, beyond 360": (np.rad2deg(np.arange(0, 30, 0.05)), np.arange(0, 30, 0.05)),
    "straight on along y": (90 + 3 * waves(), np.full(400, np.pi / 2) + np.deg2rad(3 * waves())),
}


@pytest.mark.parametrize("name", DEGREES)
@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_degrees_in_small_steps_are_told_by_the_way(tmp_path, name, noise_m):
    with pytest.warns(UserWarning, match=r"poses.txt: headings .* fits them as degrees; are they degrees\?"):
        read_poses(drive(tmp_path / "poses.txt", *DEGREES[name], noise_m=noise_m))


RADIANS = {
    "round and round": (np.arange(0, 100, 0.1), np.arange(0, 100, 0.1), 0.1),
    "the other way round, from beyond": (700 - np.arange(0, 100, 0.1), -np.arange(0, 100, 0.1) + 1, 0.1),
    "a way with bends after many turns": (20 * np.pi + waves(), waves(), 0.1),
    "straight on after many turns": (20 * np.pi + waves() / 50, waves() / 50, 0.1),
    "turning on the spot": (np.arange(0, 120, 0.5), np.zeros(240), 0.001),
    "few steps": (np.arange(0, 18, 2.0), np.zeros(9), 0.1),
    "going anywhere, whatever the heading": (np.arange(0, 60, 0.1), np.random.default_rng(1).uniform(-3, 3, 600), 0.1),
    "once around itself while it goes on": (np.linspace(0, 6.2, 100), np.zeros(100), 0.1),
}


@pytest.mark.parametrize("name", RADIANS)
def test_radians_that_wind_up_are_not(tmp_path, name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_poses(drive(tmp_path / "poses.txt", *RADIANS[name]))
