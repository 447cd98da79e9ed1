"""What is left of an evaluation in a folder."""

import json

import numpy as np
import pytest
from reports_toys import reconstructor, room

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reports.report import Report
from hilbertvae.scoring.protocol import Protocol, evaluate_all

pytestmark = pytest.mark.filterwarnings("ignore")


class BrokenMap(HilbertMap):
    """A map that fails as soon as it is fitted."""

    def _fit(self, points, occupied, weight):
        raise RuntimeError("out of order")


def test_a_mapper_that_failed_is_listed_and_leaves_the_rest_of_the_report(tmp_path, capsys):
    site, protocol = room(), Protocol(gap_seeds=[0], cluster_size_m=2.0, occlusion=False)
    mappers = {"cvae-hm": BrokenMap(reconstructor()), "nearest": NearestMapper()}
    report = Report(tmp_path, {"name": "run"})
    report(evaluate_all(mappers, site, protocol), site, mappers)
    assert report.close() == 1
    written = json.loads((tmp_path / "result.json").read_text())
    assert written["status"] == "failed" and "out of order" in written["failed"]["cvae-hm"]
    assert np.isfinite(written["scores"]["nearest"]["points"]["gaps"]["auc"]).all()
    assert (tmp_path / "pictures" / "map.png").exists() and list((tmp_path / "tensorboard").glob("events*"))
    assert "Failed: cvae-hm on room" in capsys.readouterr().out
