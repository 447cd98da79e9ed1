import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from hilbertvae.scans.quaternions import rotation_matrices, slerp


def random_quaternions(count, seed=0):
    quaternions = np.random.default_rng(seed).normal(size=(count, 4))
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


def test_matrices_are_scipys():
    quaternions = random_quaternions(50)
    np.testing.assert_allclose(rotation_matrices(quaternions), Rotation.from_quat(quaternions).as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(rotation_matrices(np.array([0, 0, 0, 1.0])), np.eye(3))


@pytest.mark.parametrize("apart", [3.0, 0.3, 1e-3, 0.0])
def test_between_two_rotations_as_scipy_goes(apart):
    for first, axis in zip(random_quaternions(20), random_quaternions(20, 1)[:, :3], strict=True):
        second = (Rotation.from_quat(first) * Rotation.from_rotvec(apart * axis / np.linalg.norm(axis))).as_quat()
        expected = Slerp([0, 1], Rotation.from_quat([first, second]))
        for share in (0.0, 0.2, 0.5, 1.0):
            for sign in (1, -1):  # q and -q are one rotation
                found = rotation_matrices(slerp(first, sign * second, share))
                np.testing.assert_allclose(found, expected(share).as_matrix(), rtol=0, atol=1e-9)
