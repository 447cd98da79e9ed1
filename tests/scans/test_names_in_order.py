"""The order of scans by the numbers in their names."""

import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.scans.names_in_order import names_in_order


def ordered(names):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return [path.name for path in names_in_order([Path(name) for name in reversed(names)])]


@pytest.mark.parametrize(
    "names",
    [
        ["2.pcd", "10.pcd", "101.pcd"],
        ["a2_b9.ply", "a2_b10.ply", "a10_b1.ply"],
        ["scan_-2.bin", "scan_-1.bin", "scan_0.bin", "scan_1.bin"],
        ["-10.xyz", "-2.xyz", "7.xyz"],
        ["scan-1.bin", "scan-2.bin", "scan-10.bin"],
        ["scan--1.bin", "scan--2.bin", "scan--10.bin"],
        ["kitchen -1.bin", "kitchen -2.bin", "kitchen -10.bin"],
        ["2026-9-30.las", "2026-11-2.las", "2026-11-20.las"],
        ["2026.9.30.las", "2026.11.2.las", "2026.11.20.las"],
        ["9.09.csv", "9.5.csv", "9.75.csv", "10.0.csv"],
        ["-1.5.csv", "-1.25.csv", "-1.05.csv", "0.5.csv"],
        ["1305031102.025.xyz", "1305031102.1753.xyz", "1305031102.2.xyz", "1305031103.xyz"],
        ["t0.5s.txt", "t0.75s.txt", "t0.8s.txt", "t1.05s.txt"],
        ["1.1.pcd", "1.2.pcd", "1.9.pcd", "1.10.pcd", "1.11.pcd", "2.1.pcd"],
        ["1.08.pcd", "1.09.pcd", "1.10.pcd", "1.11.pcd"],
        ["scan.bin", "scan1.bin", "scan2.bin"],
    ],
)
def test_a_number_counts_as_a_number(names):
    assert ordered(names) == names


@given(st.lists(st.integers(1, 10**9), min_size=2, max_size=40, unique=True))
def test_times_as_python_prints_them(micros):
    """Some have fewer digits than others, since zeros at the end are not printed."""
    times = sorted(1305031102.0 + micro / 1e6 for micro in micros)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = names_in_order([Path(f"{time}.xyz") for time in reversed(times)])
    assert [float(path.stem) for path in found] == times


@given(st.integers(10, 300), st.integers(0, 3))
def test_a_count_within_a_count(most, session):
    names = [f"{session}.{number}.ply" for number in range(1, most)]
    assert ordered(names) == names or most == 10


@pytest.mark.parametrize("names", [["1.9.pcd", "1.11.pcd"], ["1.05.pcd", "1.1.pcd", "1.100.pcd"]])
def test_what_names_leave_open_is_said(names):
    with pytest.warns(UserWarning, match=r"names like .*\.pcd are read as decimals, 1.25 before 1.3"):
        found = names_in_order([Path(name) for name in names])
    assert [float(path.stem) for path in found] == sorted(float(Path(name).stem) for name in names)
