import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.drawing import field
from hilbertvae.drawing.field import BLOCK, Field


def lattice(found):
    """{voxel index: value} of a field's voxels that were asked."""
    return {
        tuple((np.array(key) * BLOCK + place).tolist()): block[tuple(place)]
        for key, block in found.blocks.items()
        for place in np.argwhere(np.isfinite(block))
    }


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.sampled_from([3000, 10**6]))
def test_each_voxel_near_data_is_asked_once_at_its_centre(seed, reach, at_once):
    rng = np.random.default_rng(seed)
    resolution_m = 0.25
    points = rng.uniform(-3, 3, (6, 3)) + rng.choice([-16.0, 0.0, 7.9], 3)
    asked = []

    def predict(queries):
        asked.append(queries)
        return queries[:, 0] + 2 * queries[:, 1] - queries[:, 2]

    patch = pytest.MonkeyPatch()
    with patch.context() as context:
        context.setattr(field, "QUERIES_AT_ONCE", at_once)
        found = lattice(Field.near(predict, points, resolution_m, reach * resolution_m))
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3), axis=-1).reshape(-1, 3)
    expected = {tuple(index) for voxel in np.floor(points / resolution_m).astype(int) for index in (voxel + steps).tolist()}
    assert set(found) == expected and sum(map(len, asked)) == len(expected)
    for index, value in found.items():
        x, y, z = (np.array(index) + 0.5) * resolution_m
        assert value == pytest.approx(x + 2 * y - z, abs=1e-4)


def test_above_gives_centres_and_values():
    found = Field.near(lambda q: (q[:, 2] > 0.2).astype(float), np.zeros((1, 3)), 0.2, 0.4)
    centres, values = found.above(0.6)
    assert centres.shape == (2 * 5 * 5, 3)
    np.testing.assert_allclose(np.unique(centres[:, 2]), np.array([0.3, 0.5]))
    assert (values == 1).all()


def test_memory_of_a_site_of_100_m_stays_near_its_data():
    points = np.concatenate([np.zeros((1, 3)), [[1e5, -1e5, 30.0]]])
    found = Field.near(lambda q: np.ones(len(q)), points, 0.2, 1.0)
    assert len(found.blocks) <= 2 * 8


@pytest.mark.parametrize(
    ("points", "reach_m", "predict", "named"),
    [
        (np.zeros((2, 2)), 1.0, lambda q: np.ones(len(q)), "points"),
        (np.zeros((1, 3)), 26.0, lambda q: np.ones(len(q)), "reach_m"),
        (np.zeros((1, 3)), 1.0, lambda q: np.ones((len(q), 2)), "predict"),
    ],
)
def test_bad_input_is_named(points, reach_m, predict, named):
    with pytest.raises(InputError, match=named):
        Field.near(predict, points, 0.2, reach_m)
