"""One pose in the frame of another."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hilbertvae.scans.rigid_motion import motion_between


def random_pose(rng, place):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), place
    return pose


@given(st.integers(0, 2**32 - 1))
def test_what_it_finds_leads_from_the_first_to_the_second(seed):
    rng = np.random.default_rng(seed)
    first, second = (random_pose(rng, rng.uniform(-50, 50, 3)) for _ in range(2))
    np.testing.assert_allclose(first @ motion_between(first, second), second, atol=1e-12)
    np.testing.assert_allclose(motion_between(first, second), np.linalg.inv(first) @ second, atol=1e-12)


def test_places_far_from_0_lose_nothing():
    rng = np.random.default_rng(0)
    far = np.array([4e5, 5e6, 300.0])
    for _ in range(20):
        steps = rng.integers(-64, 64, (2, 3)) / 64  # exact in binary beside UTM's places
        near, there = ([random_pose(np.random.default_rng(seed), at + step) for seed, step in enumerate(steps)] for at in (0, far))
        np.testing.assert_allclose(motion_between(*there), motion_between(*near), atol=1e-15)
