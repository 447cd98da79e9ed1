import warnings
from itertools import pairwise

import numpy as np
import pytest
from bag_writers import bag, moved, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.frame_chains import are_connected, find_chain


def parents(*edges):
    """From child and parent, as "base odom"."""
    found = {}
    for edge in edges:
        child, parent = edge.split()
        found.setdefault(child, []).append(parent)
    return found


@pytest.mark.parametrize(
    ("edges", "frame", "fixed", "chain"),
    [
        (["laser base", "base odom", "odom map"], "laser", "odom", (["laser", "base", "odom"], ["odom"])),
        (["laser base", "arm base", "base odom"], "laser", "arm", (["laser", "base"], ["arm", "base"])),
        (["base odom"], "odom", "base", (["odom"], ["base", "odom"])),
        (["base odom"], "base", "base", (["base"], ["base"])),
        (["base odom"], "base", "camera", None),
        # Two parents, and one way to where poses are wanted.
        (["laser base", "base odom", "base fused"], "laser", "fused", (["laser", "base", "fused"], ["fused"])),
        (["base fused", "base odom", "odom map"], "base", "map", (["base", "odom", "map"], ["map"])),
        (["base odom", "base map", "odom map"], "base", "odom", (["base", "odom"], ["odom"])),
        (["base odom", "base fused", "arm fused"], "base", "arm", (["base", "fused"], ["arm", "fused"])),
    ],
)
def test_the_only_chain(edges, frame, fixed, chain):
    tree = parents(*edges)
    assert find_chain(tree, frame, fixed) == chain and are_connected(tree, frame, fixed) == (chain is not None)


@pytest.mark.parametrize(
    ("edges", "fixed", "message"),
    [
        (
            ["base odom", "base fused", "odom map", "fused map"],
            "map",
            r"\(base in odom and in fused\); one chain leads to odom, fused: set",
        ),
        (["base odom", "base map", "odom map"], "map", r"\(base in odom and in map\); one chain leads to odom: set reading.fixed_frame to"),
        (["base odom", "base fused", "arm odom", "arm fused"], "arm", r"\(base in odom and in fused; arm in odom and in fused\); one"),
        (
            ["base odom", "arm left", "arm right", "left odom", "right odom"],
            "arm",
            r"\(arm in left and in right\); one chain leads to odom",
        ),
    ],
)
def test_several_chains(edges, fixed, message):
    assert are_connected(parents(*edges), "base", fixed)
    with pytest.raises(InputError, match=f"transforms: expected one chain from base to {fixed}, found several {message}"):
        find_chain(parents(*edges), "base", fixed)


def test_loops():
    for frame, fixed in (("c", "a"), ("a", "c")):
        with pytest.raises(InputError, match="found a loop: a in b in a"):
            find_chain(parents("a b", "b a"), frame, fixed)
    with pytest.raises(InputError, match="found a loop: a in b in c in a"):
        find_chain(parents("base a", "base map", "a b", "b c", "c a"), "base", "map")


def test_many_ways_take_no_time():
    """Thirty diamonds one above the other have a thousand million chains; and a chain may be longer than Python's stack."""
    edges = [f"{step} {side}{step}" for step in range(30) for side in "lr"]
    edges += [f"{side}{step} {step + 1}" for step in range(30) for side in "lr"]
    with pytest.raises(InputError, match="expected one chain from 0 to 30, found several"):
        find_chain(parents(*edges), "0", "30")
    names = [str(number) for number in range(5000)]
    assert find_chain(parents(*(f"{child} {parent}" for child, parent in pairwise(names))), "0", "4999") == (names, ["4999"])


def test_a_bag_of_wheels_and_a_filter(tmp_path):
    pytest.importorskip("rosbags")
    ranges = np.random.default_rng(2).uniform(1, 20, (3, 31, 3))
    with bag(tmp_path / "a.bag") as made:
        for second in range(4):
            made.transform("/tf", second, "odom", "base", ((second, 0, 0), turned(0.1 * second)))
            made.transform("/tf", second, "odom_combined", "base", ((second, 1, 0), turned(0.2 * second)))
            made.odometry("/odom", second, "odom", "base", ((second, 0, 0), turned(0.1 * second)))
        for number in range(3):
            made.cloud("/points", number, "base", ranges[number], kind="<f8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for fixed, y, turn in ((None, 0, 0.1), ("odom", 0, 0.1), ("odom_combined", 1, 0.2)):
            scans = read_bag(tmp_path / "a.bag", fixed_frame=fixed)
            expected = np.concatenate([moved(ranges[number], ((number, y, 0), turned(turn * number))) for number in range(3)])
            np.testing.assert_allclose(scans.points, expected, rtol=0, atol=1e-9)
