"""The octree of arrays against octomap's own: its iterators, its streams, and streams that are none."""

import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.mappers.octree import DEPTH, SIDE, Leaves, leaves_of_labels, leaves_of_values, morton, stream_of

LOW, HIGH = -2.0, 3.5


def random_tree(seed, count=300):
    """Scattered voxels, and a block of 16 x 8 x 8 equal ones that lies across the origin, so that it is pruned."""
    rng = np.random.default_rng(seed)
    tree = octomap.OcTree(0.5)
    for keys in np.array_split(rng.integers(-40, 40, (count, 3)), 3):
        tree.updateNodes((keys + 0.5) * 0.5, float(rng.uniform(-3, 3)))
    block = np.stack(np.meshgrid(np.arange(-8, 8), np.arange(8), np.arange(8)), axis=-1).reshape(-1, 3)
    for _ in range(12):
        tree.updateNodes((block + 0.5) * 0.5, True)
    return tree


def nodes_of(content):
    return content[content.index(b"\ndata\n") + 6 :]


def morton_of_one(key):
    """Bit by bit: x is the lowest of each three."""
    return sum(((int(key[axis]) >> bit) & 1) << (3 * bit + axis) for bit in range(16) for axis in range(3))


def leaves_by_iteration(tree):
    """{(Morton code of the first voxel, depth): log-odds} by octomap's own iterator."""
    found = {}
    for leaf in tree.begin_leafs():
        side = 1 << (DEPTH - leaf.getDepth())
        key = [int(leaf.getKey()[axis]) // side * side for axis in range(3)]
        found[morton_of_one(key), leaf.getDepth()] = leaf.getValue()
    return found


def as_dictionary(leaves):
    return dict(zip(zip(leaves.start.tolist(), leaves.depth.tolist(), strict=True), leaves.log_odds.tolist(), strict=True))


def test_morton_code_bit_by_bit():
    keys = np.random.default_rng(0).integers(0, SIDE, (200, 3))
    keys[0], keys[1] = 0, SIDE - 1
    assert morton(keys).tolist() == [morton_of_one(key) for key in keys]
    assert morton(keys.astype(float)).tolist() == morton(keys).tolist()
    assert morton(keys[:0]).shape == (0,)


@pytest.mark.parametrize("seed", range(3))
def test_leaves_and_streams_equal_octomaps(seed):
    tree = random_tree(seed)
    stream = nodes_of(tree.write())
    leaves, count = leaves_of_values(stream)
    assert as_dictionary(leaves) == leaves_by_iteration(tree)
    assert count == tree.size() and len(leaves) == tree.getNumLeafNodes() and leaves.depth.min() < DEPTH
    assert (np.diff(leaves.start) > 0).all()
    assert stream_of(leaves) == (stream, count)


@pytest.mark.parametrize("seed", range(3))
def test_labels_equal_octomaps(seed):
    tree = random_tree(seed)
    tree.setClampingThresMin(1 / (1 + np.exp(-LOW)))
    tree.setClampingThresMax(1 / (1 + np.exp(-HIGH)))
    labels, count = leaves_of_labels(nodes_of(tree.writeBinary()), LOW, HIGH)
    assert count == tree.size()
    expected, found = leaves_by_iteration(tree), as_dictionary(labels)
    assert expected.keys() == found.keys()
    np.testing.assert_allclose(list(found.values()), [expected[leaf] for leaf in found], atol=1e-6)


def test_find_by_brute_force():
    leaves, _ = leaves_of_values(nodes_of(random_tree(4).write()))
    rng = np.random.default_rng(5)
    width = 8 ** (DEPTH - leaves.depth.astype(int))
    ends = [leaves.start - 1, leaves.start, leaves.start + width - 1, leaves.start + width]
    code = np.concatenate([morton(rng.integers(-45, 45, (400, 3)) + SIDE // 2), [0, 8**DEPTH - 1], *ends])
    held = (code[:, None] >= leaves.start) & (code[:, None] < leaves.start + width)
    np.testing.assert_array_equal(leaves.find(code), np.where(held.any(axis=1), held.argmax(axis=1), -1))
    assert (held.sum(axis=1) <= 1).all() and width.max() > 1


def test_no_leaves_and_one_leaf_all_over():
    empty, count = leaves_of_values(b"")
    assert (len(empty), count, stream_of(empty)) == (0, 0, (b"", 0))
    assert empty.find(np.arange(3)).tolist() == [-1, -1, -1]
    assert len(leaves_of_labels(b"", LOW, HIGH)[0]) == 0
    whole = Leaves(np.zeros(1, np.int64), np.zeros(1, np.int8), np.full(1, 0.7, np.float32))
    stream, count = stream_of(whole)
    assert count == 1 and as_dictionary(leaves_of_values(stream)[0]) == as_dictionary(whole)
    assert whole.find(np.array([0, 8**DEPTH - 1])).tolist() == [0, 0]


def node(value, children):
    return np.float32(value).tobytes() + bytes([children])


@pytest.mark.parametrize(
    ("stream", "message"),
    [
        (node(0, 1), "too few"),
        (node(0, 0) * 2, "too many"),
        (node(0, 1) + node(0, 0) * 2, "too many"),
        (node(0, 0)[:-1], "whole nodes"),
        (node(np.nan, 0), "finite"),
        (node(np.inf, 0), "finite"),
        (node(0, 255) * 5000, "too few"),
        (node(0, 255) * 17 + node(0, 0) * (7 * 17 + 1), "16 levels"),
        (node(0, 1) * 17 + node(0, 0), "16 levels"),
    ],
)
def test_streams_of_values_that_are_no_tree(stream, message):
    with pytest.raises(InputError, match=message):
        leaves_of_values(stream)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([3], "too few"),
        ([1, 1], "too many"),
        ([0], "children of each inner node"),
        ([3, 0], "children of each inner node"),
        ([0xFFFF] * 5000, "too few"),
        ([3] * 16 + [1], "16 levels"),
    ],
)
def test_streams_of_labels_that_are_no_tree(words, message):
    with pytest.raises(InputError, match=message):
        leaves_of_labels(np.array(words, "<u2").tobytes(), LOW, HIGH)
    with pytest.raises(InputError, match="whole nodes of 2 bytes"):
        leaves_of_labels(b"abc", LOW, HIGH)


def test_the_deepest_tree_that_octomap_has():
    leaves, _ = leaves_of_values(node(0, 1) * 16 + node(0.5, 0))
    assert as_dictionary(leaves) == {(0, 16): 0.5}
    assert as_dictionary(leaves_of_labels(np.array([3] * 15 + [2], "<u2").tobytes(), LOW, HIGH)[0]) == {(0, 16): HIGH}
    full = node(0, 255) * 16 + node(0.5, 0) * (7 * 16 + 1)  # the most siblings that can be open at once
    assert len(leaves_of_values(full)[0]) == 7 * 16 + 1


@settings(max_examples=60)
@given(st.binary(max_size=400))
def test_any_bytes_are_a_tree_or_refused(content):
    for read in (leaves_of_values, lambda stream: leaves_of_labels(stream, LOW, HIGH)):
        try:
            leaves, _ = read(content)
        except InputError:
            continue
        assert (np.diff(leaves.start) > 0).all() and (leaves.find(leaves.start) == np.arange(len(leaves))).all()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, DEPTH))
def test_random_trees_come_back(seed, count, deepest):
    """Streams made by recursion, of trees that octomap would have pruned too."""
    rng = np.random.default_rng(seed)
    left = [count]

    def branch(depth):
        children = int(rng.integers(1, 256)) if depth < deepest and left[0] > 0 else 0
        left[0] -= children.bit_count()
        below = [branch(depth + 1) for bit in range(8) if children >> bit & 1]
        value = max((value for value, _ in below), default=np.float32(rng.normal()))
        return value, node(value, children) + b"".join(stream for _, stream in below)

    stream = branch(0)[1]
    leaves, nodes = leaves_of_values(stream)
    assert stream_of(leaves) == (stream, nodes)
    assert octomap.OcTree.read(b"# Octomap OcTree file\nid OcTree\nsize %d\nres 0.1\ndata\n" % nodes + stream).write().endswith(stream)
