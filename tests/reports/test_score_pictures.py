import numpy as np
import pytest
from reports_toys import result
from scipy.stats import binomtest

from hilbertvae.reports.score_pictures import line_styles, precision_recall_picture, reliability, reliability_picture, wilson


def test_curves_are_the_result_s_means():
    found = result()
    figure = precision_recall_picture(found)
    assert [axes.get_xlabel() for axes in figure.axes] == ["recall", "recall"]
    for axes, reading in zip(figure.axes, ("points", "voxels"), strict=True):
        curves = [line for line in axes.lines if len(line.get_xdata()) == 101]
        assert len(curves) == 2
        for line, name in zip(curves, found.curves, strict=True):
            np.testing.assert_allclose(line.get_ydata(), np.mean(found.curves[name][reading], axis=0))
        cuts = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if len(line.get_xdata()) == 1]
        gaps = found.scores["cvae-hm"][reading]["gaps"]
        assert cuts[0] == pytest.approx((np.mean(gaps["recall"]), np.mean(gaps["precision"])))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["cvae-hm", "nearest"]
    figure.draw_without_rendering()


def test_gap_seeds_without_anything_occupied_have_no_curve():
    found, plain = result(mappers=("nearest",)), result(mappers=("nearest",))
    found.curves["nearest"]["points"].append([0.0] * 101)
    found.curves["nearest"]["voxels"] = [[0.0] * 101]
    points, voxels = precision_recall_picture(found).axes
    curves = [line for line in points.lines if len(line.get_xdata()) == 101]
    np.testing.assert_allclose(curves[0].get_ydata(), np.mean(plain.curves["nearest"]["points"], axis=0))
    assert not [line for line in voxels.lines if len(line.get_xdata()) == 101]
    del found.curves["nearest"]["points"]
    precision_recall_picture(found).draw_without_rendering()


def test_a_site_s_name_is_no_formula():
    found = result()
    found.site = "drive_$1_$2"
    precision_recall_picture(found).draw_without_rendering()
    reliability_picture({"nearest": (np.ones(20, bool), np.ones(20))}, found.site).draw_without_rendering()


def test_no_curves_is_an_error():
    found = result()
    found.curves = {}
    with pytest.raises(ValueError, match="curves"):
        precision_recall_picture(found)


def test_every_mapper_has_a_style_of_its_own():
    names = [f"mapper-{number}" for number in range(12)] + ["cvae-hm", "cvae-hm-points", "cvae-hm-paper"]
    styles = line_styles(names)
    assert len({(style["color"], str(style["linestyle"])) for style in styles.values()}) == len(names)


def test_networks_with_and_without_sampling_have_the_same_colour():
    styles = line_styles(["cvae-hm", "hm", "cae-hm", "cae-hm-k3"])
    assert styles["cvae-hm"]["color"] == styles["cae-hm"]["color"] == styles["cae-hm-k3"]["color"] != styles["hm"]["color"]


def test_reliability_by_brute_force():
    rng = np.random.default_rng(0)
    probability = np.append(rng.random(5000), [0.0, 1.0])
    occupied = rng.random(len(probability)) < probability
    mean, share, count = reliability(occupied, probability)
    assert count.sum() == len(probability)
    for b in (0, 6, 14):
        inside = (probability >= b / 15) & ((probability < (b + 1) / 15) | (b == 14))
        assert (count[b], mean[b], share[b]) == pytest.approx((inside.sum(), probability[inside].mean(), occupied[inside].mean()))
    figure = reliability_picture({"cvae-hm": (occupied, probability), "nearest": (occupied, np.zeros(len(occupied)))}, "room")
    assert "ECE" in figure.legends[0].get_texts()[0].get_text()
    figure.draw_without_rendering()


@pytest.mark.parametrize(("hits", "count"), [(0, 10), (10, 10), (18, 20)])
def test_an_interval_has_a_width_at_the_ends_too(hits, count):
    expected = binomtest(hits, count).proportion_ci(method="wilson")
    np.testing.assert_allclose(np.ravel(wilson(np.array([hits / count]), np.array([count]))), expected, atol=1e-4)
    figure = reliability_picture({"nearest": (np.arange(count) < hits, np.full(count, 0.9))}, "room")
    (container,) = figure.axes[0].containers
    (segment,) = container[2][0].get_segments()
    np.testing.assert_allclose(segment[:, 1], expected, atol=1e-4)
    assert not container[0].get_clip_on()
