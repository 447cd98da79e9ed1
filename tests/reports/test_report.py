"""What is left of an evaluation in a folder."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reports_toys import reconstructor
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import nn
from torch.utils.tensorboard import SummaryWriter

from hilbertvae.drawing.canvas import pixels
from hilbertvae.gaps import Gaps
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reports.report import Report, _network_figures, scores_text
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.run_folder import is_finished
from hilbertvae.reports.site_pictures import SiteMaps
from hilbertvae.scoring.cases import given_cloud
from hilbertvae.scoring.protocol import Protocol, evaluate_all
from toy_places import room

pytestmark = pytest.mark.filterwarnings("ignore")


COMMITTED = sorted((Path(__file__).parents[2] / "docs/results").rglob("scores.md"))


@pytest.mark.parametrize("path", COMMITTED, ids=lambda path: "-".join(path.parts[-3:-1]))
def test_committed_scores_are_what_the_committed_results_give(path):
    assert path.read_text(encoding="utf-8") == scores_text(read_result(path.parent / "result.json")[0])


@pytest.mark.parametrize("trained_here", [True, False])
def test_it_says_what_computed(tmp_path, monkeypatch, trained_here):
    made, site = reconstructor(), room()
    made.card = {"trained_by": "a GPU"}
    made.seconds = {"train": 3.0} if trained_here else {}
    protocol = Protocol(gap_seeds=[0], cluster_size_m=2.0, occlusion=False)
    result = evaluate_all({"nearest": NearestMapper()}, site, protocol)
    asked = []
    monkeypatch.setattr("hilbertvae.reconstruction.precision.device_name", lambda device: asked.append(device) or "another GPU")
    Report(tmp_path, {"name": "run"}, pictures=False)(
        result, site, {"nearest": NearestMapper(), "cvae-hm": HilbertMap(made, device="cuda")}
    )
    host = json.loads((tmp_path / "result.json").read_text())["host"]
    assert asked == ["cuda"] and host["filled_by"] == "another GPU"
    assert host.get("trained_by") == ("a GPU" if trained_here else None)


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


@pytest.mark.parametrize("given", ["scans", "map", "fine-map"])
def test_pictures_show_what_mappers_were_given(tmp_path, monkeypatch, given):
    site, mappers = room(), {"nearest": NearestMapper()}
    result = evaluate_all(mappers, site, Protocol(gap_seeds=[0], cluster_size_m=2.0, occlusion=False, given=given))
    drawn, draw = [], SiteMaps.draw
    monkeypatch.setattr(SiteMaps, "draw", lambda *asked: drawn.append((draw(*asked), mappers["nearest"].tree_.data)) or drawn[0][0])
    Report(tmp_path, {"name": "run"})(result, site, mappers)
    ((maps, points),) = drawn
    shown = given_cloud(site, given, maps.gaps)
    np.testing.assert_array_equal(maps.shown, maps.raster.codes(shown))
    assert sorted(map(tuple, points)) == sorted(map(tuple, shown.points))


def test_scores_stay_where_pictures_cannot_be_drawn(tmp_path, monkeypatch, capsys):
    site, protocol, mappers = room(), Protocol(gap_seeds=[0], cluster_size_m=2.0, occlusion=False), {"nearest": NearestMapper()}
    monkeypatch.setattr("hilbertvae.reports.report.reliability_picture", None)
    report = Report(tmp_path, {"name": "run"}, identity={"name": "run"})
    assert report(evaluate_all(mappers, site, protocol), site, mappers) is False
    assert report.close() == 1
    said = capsys.readouterr()
    assert "Failed: pictures of room: TypeError: " in said.out and "Traceback" in said.err
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "ok" and list((tmp_path / "tensorboard").glob("events*"))
    assert is_finished(tmp_path, ["room"], {"name": "run"}) and not is_finished(tmp_path, ["room"], {"name": "run"}, pictures=True)


class Skipping(nn.Module):
    """A network of somebody's own, whose `decode` takes what its skips keep, too."""

    def __init__(self, inner):
        super().__init__()
        self.inner = inner

    def forward(self, grids):
        return self.decode(None, grids)

    def decode(self, z, kept):
        return self.inner(kept)


def test_a_network_that_decodes_more_than_z_has_all_pictures_but_that_of_its_prior():
    site, made = room(), reconstructor()
    gaps = Gaps(np.array([[2.0, 0.5]]), np.array([0.8]), site.resolution_m)
    shown = gaps.cut(site.fit)
    drawn = []
    for network in (made.network, Skipping(made.network)):
        mapper = HilbertMap(replace(made, network=network)).fit(shown.points, shown.occupied, shown.weight)
        drawn.append(set(_network_figures(mapper, site, shown, gaps)))
    assert drawn[0] - drawn[1] == {"prior"} and drawn[1] <= drawn[0]


def test_scores_and_pictures_of_a_site_share_a_tag(tmp_path):
    site = replace(room(), name="simulated:7")
    mappers = {"nearest": NearestMapper()}
    Report(tmp_path, {"name": "run"})(evaluate_all(mappers, site, Protocol([0], cluster_size_m=2.0, occlusion=False)), site, mappers)
    tags = EventAccumulator(str(tmp_path / "tensorboard")).Reload().Tags()
    assert tags["images"] and all(tag.startswith("simulated_7/") for tag in tags["images"])
    assert "simulated_7/scores/text_summary" in tags["tensors"]


def test_a_run_that_is_scored_again_shows_its_new_scores_alone_beside_its_curves(tmp_path):
    site, protocol = room(), Protocol([0], cluster_size_m=2.0, occlusion=False)
    with SummaryWriter(tmp_path / "tensorboard") as training:
        training.add_scalar("train/loss", 1.0, 7)
    for names in (("nearest", "gone"), ("nearest",)):
        mappers = {name: NearestMapper() for name in names}
        report = Report(tmp_path, {"name": "run"}, pictures=False)
        for name in ("first", "second"):
            tested = replace(site, name=name)
            report(evaluate_all(mappers, tested, protocol), tested, mappers)
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert [point.step for point in events.Scalars("train/loss")] == [7]
    for name in ("first", "second"):
        assert len(events.Scalars(f"score/{name}/nearest/voxels/gaps/auc")) == 1
    assert len(events.Scalars("headline/gaps_voxels_auc")) == 1
    assert not [tag for tag in events.Tags()["scalars"] if "/gone/" in tag]


def test_pictures_of_an_earlier_scoring_do_not_pass_for_those_of_a_later_one(tmp_path):
    """A job that is asked for pictures would else be told that they are there."""
    site, mappers = room(), {"nearest": NearestMapper()}
    for old in (tmp_path / "pictures/map.png", tmp_path / "surface.ply"):
        old.parent.mkdir(exist_ok=True)
        old.write_bytes(b"")
    result = evaluate_all(mappers, site, Protocol([0], cluster_size_m=2.0, occlusion=False))
    Report(tmp_path, {"name": "run"}, identity={}, pictures=False)(result, site, mappers)
    assert is_finished(tmp_path, [site.name], {}) and not is_finished(tmp_path, [site.name], {}, pictures=True)
    assert not (tmp_path / "surface.ply").exists()


def test_gaps_in_which_no_voxel_lies_have_no_reliability_to_be_shown(tmp_path):
    site, mappers = room(), {"nearest": NearestMapper()}
    result = evaluate_all(mappers, site, Protocol([3], cluster_size_m=2.0, gap_ratio=0.07, occlusion=False))
    assert result.scores["nearest"]["voxels"]["gaps"]["count"] == [0]
    Report(tmp_path, {"name": "run"})(result, site, mappers)
    pictures = {path.stem for path in (tmp_path / "pictures").glob("*.png")}
    assert "gaps" in pictures and "reliability" not in pictures


@pytest.mark.parametrize("seeds", [[3, 1], [3]])
def test_pictures_of_one_gap_seed_s_gaps_say_of_which(tmp_path, monkeypatch, seeds):
    site, mappers, drawn = room(), {"nearest": NearestMapper()}, {}
    result = evaluate_all(mappers, site, Protocol(seeds, cluster_size_m=2.0, occlusion=False))
    monkeypatch.setattr("hilbertvae.reports.report.save_picture", lambda figure, path: drawn.update({path.stem: figure}) or pixels(figure))
    Report(tmp_path, {"name": "run"})(result, site, mappers)
    said = {name: figure.get_suptitle() for name, figure in drawn.items()}
    of_gaps = "gap seed 3, the first of 2" if len(seeds) > 1 else "gap seed 3"
    assert said == {**dict.fromkeys(("map", "gaps", "reliability"), of_gaps), "precision_recall": "", "sites": ""}


def test_a_site_with_too_few_returns_for_a_box_has_no_pictures_of_boxes():
    site = room()
    mapper = HilbertMap(reconstructor())
    few = site.fit.select(np.append(np.flatnonzero(site.fit.occupied)[:2], np.flatnonzero(~site.fit.occupied)))
    assert _network_figures(mapper, site, few, Gaps(np.zeros((1, 2)), np.ones(1), 0.1)) == {}
