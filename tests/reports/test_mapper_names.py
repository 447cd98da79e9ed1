"""What names say, of the rows that come with the package and of a user's own."""

from pathlib import Path

import pytest
import yaml

from hilbertvae.reports.mapper_names import (
    CHAMPIONS,
    champions,
    configured_as,
    for_points,
    is_network,
    is_rival,
    reading_of,
    without_sampling,
)

SHIPPED = {
    name: settings
    for path in (Path(__file__).parents[2] / "conf/mapper").glob("*.yaml")
    for name, settings in yaml.safe_load(path.read_text(encoding="utf-8")).items()
}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_names_of_configured_mappers_say_what_their_settings_are(name):
    settings = SHIPPED[name]
    assert is_network(name) == ("reconstructor" in settings)
    if is_network(name):
        assert reading_of(name) == settings.get("calibration", "voxels")
        assert is_network(without_sampling(name)) and configured_as(without_sampling(name)) == name


def test_all_but_networks_and_what_knows_the_gaps_are_rivals():
    assert [name for name in ("cvae-hm-k3", "cae-hm", "gap-centre", "hm", "raw-grid-hm", "lard-hm") if is_rival(name)] == [
        "hm", "raw-grid-hm", "lard-hm",
    ]  # fmt: skip


def test_champions_stand_for_their_reading():
    for reading, names in CHAMPIONS.items():
        assert {reading_of(name) for name in names} == {reading}
    scored = ["hm", "cae-hm-k3", "cae-hm-points-k3", "cae-hm", "cae-hm-paper"]
    assert champions(scored, "voxels") == ["cae-hm", "cae-hm-paper", "cae-hm-k3", "cae-hm-points-k3"]
    assert champions(scored, "points") == ["cae-hm-paper", "cae-hm", "cae-hm-points-k3", "cae-hm-k3"]
    assert champions(["hm", "gpom"], "points") == []


def test_the_row_beside_one_that_is_calibrated_for_points():
    assert for_points("cvae-hm") == "cvae-hm-points" and for_points("cae-hm-adapted") == "cae-hm-points-adapted"
