from types import SimpleNamespace

import numpy as np
import pytest

from hilbertvae.scans.bag_messages import LASER_SCAN, POINT_CLOUD
from hilbertvae.scans.point_times import beam_times, says_times, usual_step_ns

STAMP_NS = 1_700_000_000_123_456_789
SWEEP_S = np.linspace(0.0, 0.1, 101)


@pytest.mark.parametrize(
    ("step", "beams", "expected"),
    [(0.001, 101, 100_000_000), (0.0, 101, None), (-0.001, 101, -100_000_000), (-0.02, 101, None),
     (np.nan, 101, None), (np.inf, 101, None), (17.4, 101, None),
     (0.001, 1, None), (0.001, 0, None)],
)  # fmt: skip
def test_a_laser_turns_for_so_long(step, beams, expected):
    message = SimpleNamespace(__msgtype__=LASER_SCAN, time_increment=step, ranges=np.ones(beams))
    times = beam_times(message, STAMP_NS, np.ones(beams, bool))
    assert says_times(message) == (step != 0 and beams > 1)
    assert times is None if expected is None else times.tolist() == [beam * expected // (beams - 1) for beam in range(beams)]


def cloud(values, name="t", **changes):
    codes = {"i1": 1, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
    field = SimpleNamespace(name=name, offset=4, datatype=codes[values.dtype.str[1:]], count=1)
    data = np.zeros((len(values), 4 + values.itemsize), np.uint8)
    data[:, 4:] = values.reshape(-1, 1).view(np.uint8)
    said = dict(fields=[field], width=len(values), height=1, point_step=data.shape[1], row_step=0, data=data.reshape(-1))
    return SimpleNamespace(__msgtype__=POINT_CLOUD, is_bigendian=values.dtype.str[0] == ">", **(said | changes))


def times_of(values, returned=None, **changes):
    return beam_times(cloud(values, **changes), STAMP_NS, np.ones(len(values), bool) if returned is None else returned)


@pytest.mark.parametrize("name", ["t", "time", "TIME", "timestamp", "offset_time", "timeOffset"])
@pytest.mark.parametrize(
    ("values", "to_ns"),
    [
        (np.round(SWEEP_S * 1e9).astype("<u4"), 1),
        (np.round(SWEEP_S * 1e9).astype(">u4"), 1),
        (np.round(SWEEP_S * 1e9).astype("<i4"), 1),
        (np.round(SWEEP_S * 1e6).astype("<u4"), 1_000),
        ((SWEEP_S * 1e3).astype("<f4"), 60_000),
        (SWEEP_S.astype("<f4"), 60_000),
        ((STAMP_NS / 1e9 + SWEEP_S).astype("<f8"), 1_000),
        ((STAMP_NS / 1e6 + SWEEP_S * 1e3).astype("<f8"), 1_000),
        ((STAMP_NS / 1e3 + SWEEP_S * 1e6).astype("<f8"), 1_000),
        ((STAMP_NS + SWEEP_S * 1e9).astype("<f8"), 1_000),
    ],
)
def test_any_unit_from_the_message_or_by_the_clock(values, to_ns, name):
    """To what the numbers themselves hold: float32 6 digits, float64 of the clock a quarter of a microsecond."""
    np.testing.assert_allclose(times_of(values, name=name), SWEEP_S * 1e9, rtol=0, atol=to_ns)


def test_a_sweep_may_end_at_its_time_and_come_in_any_order():
    order = np.random.default_rng(0).permutation(101)
    found = times_of((SWEEP_S - 0.1).astype("<f4")[order])
    np.testing.assert_allclose(found, (SWEEP_S[order] - 0.1) * 1e9, rtol=0, atol=60)


@pytest.mark.parametrize("sweep_s", [0.002, 0.02, 0.2, 1.0])
@pytest.mark.parametrize("scale", [1, 10**3, 10**6, 10**9])
def test_each_sweep_fits_one_unit(sweep_s, scale):
    values = np.array([0.0, sweep_s / 2, sweep_s]) * scale
    np.testing.assert_allclose(times_of(values), np.array([0.0, 0.5, 1.0]) * sweep_s * 1e9, rtol=1e-6)


def test_times_of_what_did_not_return_do_not_matter():
    values = (STAMP_NS / 1e9 + SWEEP_S).astype("<f8")
    values[[3, 7, 9]] = 0.0, np.nan, np.inf
    returned = np.ones(101, bool)
    returned[[3, 7, 9]] = False
    found = times_of(values, returned)
    np.testing.assert_allclose(found[returned], SWEEP_S[returned] * 1e9, rtol=0, atol=1_000)
    assert np.abs(found[~returned]).max() <= 1_000
    assert times_of(values, np.zeros(101, bool)) is None


@pytest.mark.parametrize(
    "values",
    [
        SWEEP_S * 15,
        SWEEP_S * 1e-3 * 1e-9,
        SWEEP_S + 3600.0,
        STAMP_NS / 1e9 + 3600 + SWEEP_S,
        np.where(np.arange(101) == 5, np.nan, SWEEP_S),
        np.where(np.arange(101) == 5, np.inf, SWEEP_S),
        np.where(np.arange(101) % 2, 1e308, -1e308),
    ],
    ids=["1.5 s", "none", "an hour later", "another clock", "NaN", "inf", "huge"],
)
def test_nonsense_is_no_time(values):
    assert times_of(values) is None


def test_all_at_once():
    assert times_of(np.full(101, 17.0)).tolist() == [0] * 101


def test_fields_that_are_none():
    values = np.round(SWEEP_S * 1e9).astype("<u4")
    assert times_of(values, name="intensity") is None
    assert times_of(values, point_step=6) is None
    assert times_of(values, data=np.zeros(7, np.uint8)) is None


def test_a_sweep_takes_no_longer_than_two_scans():
    values, returned = np.round(SWEEP_S * 1e9).astype("<u4"), np.ones(101, bool)
    laser = SimpleNamespace(__msgtype__=LASER_SCAN, time_increment=0.001, ranges=np.ones(101))
    for message in (cloud(values), laser):
        assert np.ptp(beam_times(message, STAMP_NS, returned, 0.05e9)) == pytest.approx(1e8)
        assert beam_times(message, STAMP_NS, returned, 0.0499e9) is None


def test_the_usual_time_from_scan_to_scan():
    """That of each sensor of a topic, whatever was dropped or comes a second time."""
    lidar = [100, 200, 300, 600, 700, 800, 100, 200, 300]
    assert usual_step_ns({"lidar": lidar}) == usual_step_ns({"left": lidar, "right": [stamp + 3 for stamp in lidar]}) == 100
    assert usual_step_ns({}) == usual_step_ns({"lidar": [5]}) == usual_step_ns({"lidar": [5, 5]}) == np.inf
