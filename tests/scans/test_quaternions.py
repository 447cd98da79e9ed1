import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from hilbertvae.scans.quaternions import slerp


def random_quaternions(count, seed=0):
    quaternions = np.random.default_rng(seed).normal(size=(count, 4))
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


@pytest.mark.parametrize("apart", [3.0, 0.3, 1e-3, 0.0])
def test_between_two_rotations_as_scipy_goes(apart):
    for first, axis in zip(random_quaternions(20), random_quaternions(20, 1)[:, :3], strict=True):
        second = (Rotation.from_quat(first) * Rotation.from_rotvec(apart * axis / np.linalg.norm(axis))).as_quat()
        expected = Slerp([0, 1], Rotation.from_quat([first, second]))
        for share in (0.0, 0.2, 0.5, 1.0):
            for sign in (1, -1):  # q and -q are one rotation
                found = Rotation.from_quat(slerp(first, sign * second, share)).as_matrix()
                np.testing.assert_allclose(found, expected(share).as_matrix(), rtol=0, atol=1e-9)
