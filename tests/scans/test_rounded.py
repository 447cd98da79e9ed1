import warnings

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hilbertvae.cloud import cloud_from_scans
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.rounded import LEFT_OVER_M, digits_kept, warn_if_rounded
from toy_rooms import carmen_line, write_log


@pytest.mark.parametrize(
    ("points", "told"),
    [
        (np.float16([[500.25, 1.1]]), "half precision, which keeps them to 0.25 m"),
        (np.float16([[1e4, 2.0]]), "half precision, which keeps them to 8 m"),
        (np.float32([[5.4e6, 1.1]]), "single precision, which keeps them to 0.5 m"),
        (np.float32([[5.4e6, np.nan], [1.1, np.inf]]), "single precision, which keeps them to 0.5 m"),
        (np.array([[500.3, 1.1]]), ""),
        (np.array([[500.0, 7.0]]), ""),  # whole metres are of any precision
        (np.array([[5.4e6 + 0.3, 1.1]]), ""),
        (np.float32([[1e5, 1.1]]), ""),
        (np.full((3, 2), np.nan), ""),
        (np.append(np.tile([[500.25, 1.5]], (200, 1)), [[500.3, 1.5]], axis=0), ""),
        (np.array([[512346.0, 5.37654e6], [512347.0, 412.305]]), "at most 6 digits, which keep them to 10 m"),
        (np.array([[512346.1, 5376544.0], [512347.2, np.nan]]), "at most 7 digits, which keep them to 1 m"),
        (np.array([[512346.12, 5376544.0], [512347.2, 0.0]]), ""),
        (np.array([[12345.6, 0.1], [12345.7, 0.2]]), "at most 6 digits, which keep them to 0.1 m"),
        (np.array([[123.456, 0.1], [-1.23456, 0.0]]), ""),  # six digits of a cloud in its sensor's frame are enough
        (np.array([[5.4e6, 1.1], [5.3e6, 1e-320]]), ""),
        (np.array([[1e300, 5e-324], [-1e-300, np.inf]]), ""),
        (np.array([[512346.0, 5.37654e6], [2.2e-308, 412.305]]), "at most 6 digits, which keep them to 10 m"),  # a zero, nearly
    ],
)
def test_what_was_kept_in_few_bits_is_told(points, told):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_if_rounded(points.astype(float), "a.npz", "origins")
    assert ["a.npz: its origins, up to" in str(warning.message) and told in str(warning.message) for warning in caught] == [True] * bool(
        told
    )


def test_origins_are_looked_at_too(tmp_path):
    points = np.random.default_rng(0).uniform(size=(50, 2)) * 8 + 5.4e6
    np.savez(tmp_path / "a.npz", points=points, origins=np.full(2, 5.4e6 + 0.3, np.float32))
    with pytest.warns(UserWarning, match="a.npz: its origins, up to 5400000 m, are in single precision"):
        read_scans_path(str(tmp_path / "a.npz"), ReadingSettings())


@given(
    places=arrays(float, (20, 2), elements=st.floats(-1e7, 1e7, allow_subnormal=False)),
    digits=st.integers(1, 9),
)
def test_digits_are_those_that_places_are_written_with(places, digits):
    """By numpy at once; here by writing and reading them one by one."""
    written = np.array([[float(f"{number:.{digits - 1}e}") for number in row] for row in places])
    finite = written[np.abs(written) >= LEFT_OVER_M]
    expected = (
        next((few for few in range(1, 8) if all(float(f"{number:.{few - 1}e}") == number for number in finite)), 0) if len(finite) else 0
    )
    step_m, found = digits_kept(written)
    assert found == expected
    if expected:
        assert step_m == pytest.approx(10.0 ** (int(f"{np.abs(finite).max():.6e}".split("e")[1]) + 1 - expected))


def test_places_in_half_metres_are_of_no_few_bits(tmp_path, recwarn):
    """A robot that went on in steps of half a metre, 70 m far."""
    log = write_log(tmp_path / "a.log", [carmen_line(np.full(180, 2.0), [0.5 * number, 0.25, 0.1]) for number in range(140)])
    assert len(read_scans_path(str(log), ReadingSettings())) and not recwarn.list


def test_a_text_cloud_and_a_log_in_few_digits_are_told(tmp_path):
    points = np.random.default_rng(0).uniform(size=(50, 3)) * 8 + [512345.6, 5376543.2, 412.3]
    (tmp_path / "a.xyz").write_text("".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in points))
    with pytest.warns(UserWarning, match="a.xyz: its coordinates, up to 5376550 m, have at most 6 digits, which keep them to 10 m"):
        read_scans_path(str(tmp_path / "a.xyz"), ReadingSettings(sensor_origin_m=[512346.0, 5376544.0, 413.0]))
    log = write_log(tmp_path / "a.log", [carmen_line(np.full(180, 2.0), [float(f"{x:g}"), float(f"{y:g}"), 0.1]) for x, y, _ in points])
    with pytest.warns(UserWarning, match="a.log: its places, up to 5376550 m, have at most 6 digits, which keep them to 10 m"):
        read_scans_path(str(log), ReadingSettings())


@pytest.mark.parametrize("origin", [[450000.0, 5400000.0, 301.5], [450000.0, 5399996.0, 301.7]])
def test_an_origin_of_round_numbers_is_of_no_few_bits_or_digits(tmp_path, recwarn, origin):
    points = np.random.default_rng(0).uniform(size=(50, 3)) * 8 + origin
    np.savez(tmp_path / "a.npz", points=points, origins=np.array(origin))
    read_scans_path(str(tmp_path / "a.npz"), ReadingSettings())
    for origins in (origin, [origin], np.array(origin)):
        cloud_from_scans(points if np.ndim(origins) == 1 else [points], origins)
    assert not recwarn.list
    with pytest.warns(UserWarning, match="origins: its coordinates, up to 5[0-9]* m, are in single precision"):
        cloud_from_scans(points, np.float32(origin) + np.float32(0.3))


def test_whole_numbers_of_millimetres_are_of_no_few_bits():
    """They are in millimetres, which is what is said, and in no precision."""
    points, origin = np.random.default_rng(0).integers(-5000, 5000, (10, 3)).astype(np.int32), np.array([1000, 2000, 512], np.int32)
    with pytest.warns(UserWarning) as said:
        cloud_from_scans(points, np.tile(origin, (10, 1)))
    assert ["millimetres" in str(warning.message) for warning in said] == [True]


@pytest.mark.parametrize("step_m", [0.5, 0.25, 0.125])
def test_round_coordinates_are_of_no_few_bits(step_m, recwarn):
    """A lattice of them, as one asks a map: half precision has them all, and would have finer ones near the origin."""
    lattice = np.stack(np.meshgrid(*[np.arange(-60, 60, step_m)] * 2), axis=-1).reshape(-1, 2)
    warn_if_rounded(lattice, "asked.csv", came_as=np.float64)
    assert not recwarn.list
    with pytest.warns(UserWarning, match="are in half precision, which keeps them to 0.031 m"):
        warn_if_rounded((lattice + 0.03).astype(np.float16).astype(float), "asked.csv", came_as=np.float64)


@pytest.mark.parametrize("kind", [np.float32, torch.float32, np.float64, list])
def test_mappers_tell_of_far_points_in_single_precision(kind):
    rng = np.random.default_rng(0)
    points, occupied = rng.uniform(0, 8, (400, 2)) + [4e5, 5e6], rng.random(400) < 0.4

    def given(values):
        if kind is list:
            return values.tolist()
        return torch.tensor(values, dtype=kind) if isinstance(kind, torch.dtype) else values.astype(kind)

    single = "32" in str(kind)
    mapper = NearestMapper().fit(points, occupied)
    for ask, labels, what in ((NearestMapper().fit, [occupied], "points"), (mapper.predict_proba, [], "queries")):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            ask(given(points), *labels)
        told = [str(warning.message) for warning in said]
        assert len(told) == single and all(f"{what}: its coordinates, up to 500000" in text for text in told), told
        assert all(warning.filename == __file__ for warning in said)


def test_whole_metres_in_single_precision_lose_nothing(recwarn):
    points = np.random.default_rng(0).integers(0, 8, (400, 2)) + [412340, 5428340]
    mapper = NearestMapper().fit(points.astype(np.float32), np.arange(400) % 3 == 0)
    mapper.predict_proba(points.astype(np.float32))
    assert not recwarn.list


@pytest.mark.parametrize("height_m", [0.0, 1.5])
def test_a_plane_in_single_precision_is_told(height_m):
    """Its one height is a whole step of the farthest coordinate, and says nothing."""
    points = np.random.default_rng(0).uniform(0, 40, (500, 2)) + [384000, 398000]
    flat = np.column_stack([points, np.full(500, height_m)]).astype(np.float32)
    with pytest.warns(UserWarning, match="single precision, which keeps them to 0.031 m"):
        warn_if_rounded(flat.astype(float), "a.npz")
