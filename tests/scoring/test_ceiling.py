import numpy as np
import pytest

from hilbertvae.mappers.constant import ConstantMapper
from hilbertvae.reports.score_table import rows_of
from hilbertvae.scans.scan import Scans
from hilbertvae.scoring.ceiling import ceiling
from hilbertvae.scoring.protocol import Protocol, evaluate
from hilbertvae.site import Site
from hilbertvae.voxel_votes import voxel_index


def test_ceiling_by_brute_force(place):
    """The best constant per cell, scored on held-out beams by counting."""
    found = ceiling(place)
    for reading, cloud, held_out in (("points", place.points, place.points_held_out), ("voxels", place.voxels, place.voxels_held_out)):
        cells = {}
        for index, occupied in zip(voxel_index(cloud.points, place.resolution_m).tolist(), cloud.occupied, strict=True):
            cells.setdefault(tuple(index), []).append(bool(occupied))
        called = right = positive = 0
        for index, occupied, out in zip(voxel_index(cloud.points, place.resolution_m).tolist(), cloud.occupied, held_out, strict=True):
            if out:
                votes = cells[tuple(index)]
                says = 2 * sum(votes) >= len(votes)
                called, right, positive = called + says, right + (says and occupied), positive + bool(occupied)
        assert found[reading]["precision"] == pytest.approx(right / called)
        assert found[reading]["recall"] == pytest.approx(right / positive)
    assert found["voxels"] == {"precision": 1.0, "recall": 1.0}


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_sensor_at_the_edge_of_the_map(dimension):
    """Free points close to a sensor that looks into a room from its edge lie in voxels that no beam is counted in."""
    rng = np.random.default_rng(0)
    origins = np.full((4000, dimension), 0.08)
    points = np.column_stack([rng.uniform(3, 3.05, 4000), *rng.uniform(0.1, 3, (dimension - 1, 4000))])
    site = Site("edge", Scans(points, origins, np.arange(4000) // 200, np.arange(4000) % 200), 0.1)
    found = evaluate(ConstantMapper(), site, Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=1.2), "all")
    assert found.ceiling["points"]["recall"] > 0.9


def test_held_out_beams_that_met_nothing_say_nothing_of_a_best():
    """As few beams as a tenth rarely is of; 0 / 0 would read as if nobody could do better."""
    site = Site("two", Scans(np.array([[3.0, 1.0], [2.0, 2.5]]), np.full((2, 2), 0.05), np.zeros(2, int), np.arange(2, 4)), 0.1)
    assert not site.points.occupied[site.points_held_out].any()
    assert ceiling(site) == {}
    found = evaluate(ConstantMapper(), site, Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=1.2), "all")
    assert rows_of(found, "points", metrics={"precision": "P"})[-1] == ["ceiling", "-", "-"]
