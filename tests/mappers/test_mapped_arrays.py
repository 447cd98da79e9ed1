"""joblib gives its workers arrays that are mapped from a file and can't be written to: a map goes on growing with copies."""

import copy

import joblib
import numpy as np
import pytest

from hilbertvae.cloud import fit_cloud
from hilbertvae.mappers.hilbert_map import HilbertMap
from toy_rooms import tiny_reconstructor


@pytest.mark.parametrize("reconstruct", [True, False])
def test_a_mapped_map_grows_as_any_other(room, tmp_path, reconstruct):
    first, second, third = (fit_cloud(room.scans.select(room.scans.scan == number), room.resolution_m) for number in range(3))
    grown = HilbertMap(tiny_reconstructor(2)).fit(first.points, first.occupied, first.weight)
    for cloud in (second, third):  # before the second a map has nothing that grows yet
        joblib.dump(grown, tmp_path / "map.joblib")
        mapped = joblib.load(tmp_path / "map.joblib", mmap_mode="r")
        before = (tmp_path / "map.joblib").read_bytes()
        mapped.predict_proba(room.fit.points)
        twin = copy.deepcopy(grown)
        for each in (mapped, twin):
            each.partial_fit(cloud.points, cloud.occupied, cloud.weight, reconstruct=reconstruct)
        np.testing.assert_array_equal(mapped.predict_proba(room.fit.points), twin.predict_proba(room.fit.points))
        assert (tmp_path / "map.joblib").read_bytes() == before
        grown.partial_fit(cloud.points, cloud.occupied, cloud.weight, reconstruct=reconstruct)


def test_what_waits_for_a_query_is_reconstructed_in_a_mapped_map(room, tmp_path):
    first, second = (fit_cloud(room.scans.select(room.scans.scan == number), room.resolution_m) for number in range(2))
    grown = HilbertMap(tiny_reconstructor(2)).fit(first.points, first.occupied, first.weight)
    grown.partial_fit(second.points, second.occupied, second.weight, reconstruct=False)
    joblib.dump(grown, tmp_path / "map.joblib")
    mapped = joblib.load(tmp_path / "map.joblib", mmap_mode="r")
    np.testing.assert_array_equal(mapped.predict_proba(room.fit.points), grown.predict_proba(room.fit.points))
