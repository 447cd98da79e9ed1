import shutil
from dataclasses import replace

import pytest
from training_toys import tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.files import path_sha256
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reconstruction.training_card import many_simulated
from hilbertvae.scans.sites import CATALOGUE
from hilbertvae.training.given_networks import give_networks, load_named
from hilbertvae.training.site_roles import check_roles, check_unseen, own_sites, place
from hilbertvae.training.train import train
from toy_rooms import tiny_reconstructor

CARD = {
    "trained_on": ["fr079", "30 simulated buildings"],
    "validated_on": "csail",
    "started_from": {"trained_on": ["aces", "simulated:77", "12 simulated buildings from 1600 on"], "validated_on": "fhw"},
}


def test_a_simulated_site_has_one_number():
    with pytest.raises(InputError, match="data.test: simulated:07 is also trained or validated on"):
        check_roles(["simulated:7"], "csail", ["simulated:07"])


@pytest.mark.parametrize("key", ["train", "calibrate"])
def test_what_is_learned_from_is_given_once(key):
    sites = {"train": ["fr079", "simulated:7"], "calibrate": ["simulated:8"]}
    check_roles(sites["train"], "csail", [], sites["calibrate"])
    sites[key] = ["simulated:9", *sites[key], "simulated:09"]
    with pytest.raises(InputError, match=f"data.{key}: expected each site once, .* got simulated:9, simulated:09$"):
        check_roles(sites["train"], "csail", [], sites["calibrate"])


def test_a_test_site_is_given_once():
    with pytest.raises(InputError, match="^data.test: expected each site once, .* got simulated:8, simulated:08$"):
        check_roles([], "csail", ["simulated:8", "intel", "simulated:08"])


def test_a_copy_of_a_real_site_is_that_site(tmp_path, monkeypatch):
    """Whatever its name: what lies in the file decides."""
    log = tmp_path / "office.log"
    log.write_text("FLASER 1 1.0 0 0 0 0 0 0 0 host 0\n")
    monkeypatch.setitem(CATALOGUE, "fr079", replace(CATALOGUE["fr079"], sha256=path_sha256(log)))
    copy = shutil.copy(log, tmp_path / "copy.log")
    assert place(str(copy)) == "fr079"
    with pytest.raises(InputError, match="copy.log is also trained or validated on"):
        check_roles(["fr079"], "csail", [str(copy)])


def test_a_copy_of_ones_own_site_is_that_site(tmp_path):
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive/0.txt").write_text("1 2 3")
    copy = shutil.copytree(tmp_path / "drive", tmp_path / "copy")
    with pytest.raises(InputError, match="data.test: .*copy is also trained or validated on"):
        check_roles([str(tmp_path / "drive")], "csail", [str(copy)])
    (copy / "0.txt").write_text("1 2 4")
    check_roles([str(tmp_path / "drive")], "csail", [str(copy)])


@pytest.mark.parametrize("site", ["fr079", "aces", "simulated:0", "simulated:029", "simulated:77", "simulated:1600", "simulated:1611"])
def test_what_a_network_was_trained_on_is_no_test(site):
    with pytest.raises(InputError, match=f"data.test: {site} is among what the network was trained on"):
        check_unseen(["intel", site], CARD, "data.test", "the network")


def test_what_a_network_has_not_seen_is_one_and_its_validation_site_may_be_asked():
    check_unseen(
        ["intel", "csail", "fhw", "simulated:30", "simulated:1599", "simulated:1612", "simulated:900002", "no/such/path.log"],
        CARD,
        "data.test",
        "the network",
    )
    check_unseen(["intel"], {}, "data.test", "the network")


def test_a_site_of_the_catalogue_that_was_trained_on_as_a_copy_is_none_to_test_on(tmp_path, monkeypatch):
    """Also where the copy is gone: the card has its sha256."""
    copy = tmp_path / "office.log"
    copy.write_text("FLASER 1 1.0 0 0 0 0 0 0 0 host 0\n")
    monkeypatch.setitem(CATALOGUE, "fr079", replace(CATALOGUE["fr079"], sha256=path_sha256(copy)))
    card = {"trained_on": [str(copy)], "trained_on_sha256": own_sites([str(copy)])}
    copy.unlink()
    with pytest.raises(InputError, match="data.test: fr079 is among what"):
        check_unseen(["intel", "fr079"], card, "data.test", "the network")
    check_unseen(["intel"], card, "data.test", "the network")


def test_a_training_site_that_was_moved_is_none_to_test_on(tmp_path):
    (tmp_path / "drives/monday").mkdir(parents=True)
    (tmp_path / "drives/monday/0.txt").write_text("1 2 3")
    (tmp_path / "drives/tuesday.txt").write_text("4 5 6")
    monday = str(tmp_path / "drives/monday")
    before = {"trained_on": [monday], "trained_on_sha256": own_sites([monday, "fr079", "simulated:1", "no/such.log"])}
    assert [*before["trained_on_sha256"]] == [monday]
    moved = str((tmp_path / "drives/monday").rename(tmp_path / "office"))
    for card in (before, {"trained_on": ["fr079"], "started_from": before}):
        with pytest.raises(InputError, match="data.test: .*office is among what the network was trained on"):
            check_unseen([moved], card, "data.test", "the network")
        check_unseen([str(tmp_path / "drives/tuesday.txt"), "intel"], card, "data.test", "the network")
    with pytest.raises(InputError, match="data.test: .*monday is among"):
        check_unseen([monday], before, "data.test", "the network")
    check_unseen([moved], {"trained_on": [monday]}, "data.test", "the network")  # a card of before has the path alone


def test_what_would_take_long_to_read_is_known_by_its_path(tmp_path, monkeypatch):
    (tmp_path / "drive.txt").write_text("1 2 3")
    assert own_sites([str(tmp_path / "drive.txt")])
    monkeypatch.setattr("hilbertvae.training.site_roles.LARGEST_BYTES", 5)
    assert not own_sites([str(tmp_path / "drive.txt")])


@pytest.mark.parametrize("first", [0, 1600])
@pytest.mark.parametrize("kind", ["buildings", "streets", "streets and floors"])
def test_a_card_says_which_simulated_sites_it_was(first, kind):
    card = {"trained_on": [many_simulated(kind, 5, first)]}
    for site in range(first, first + 5):
        with pytest.raises(InputError, match=f"simulated:{site} is among"):
            check_unseen([f"simulated:{site}"], card, "data.test", "the network")
    check_unseen([f"simulated:{site}" for site in (first + 5, first + 1600)], card, "data.test", "the network")


def test_networks_are_asked_before_anything_is_scored(tmp_path):
    network = tiny_reconstructor(2)
    network.card = CARD
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    settings = replace(settings, data=replace(settings.data, test=["fr079"]))
    with pytest.raises(InputError, match="data.test: fr079 is among what the network of mapper.cvae-hm was trained on"):
        give_networks(settings, {"cvae-hm": HilbertMap("trained")}, network)


def test_a_site_that_taught_a_map_its_weights_is_scored_with_a_warning(tmp_path, recwarn):
    network = tiny_reconstructor(2)
    network.card = {"calibrated_on": ["simulated:900010", "csail"]}
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    for test in ("simulated:0900010", "csail"):
        known = replace(settings, data=replace(settings.data, test=["simulated:900011", test]))
        with pytest.warns(UserWarning, match=f"^data.test: mapper.cvae-hm learned its map's weights on {test}, and"):
            load_named(known, {"cvae-hm": HilbertMap(network)})
    load_named(replace(settings, data=replace(settings.data, test=["simulated:900011"])), {"cvae-hm": HilbertMap(network)})
    assert not recwarn.list


def test_a_training_that_goes_on_asks_the_network_it_starts_from(tmp_path):
    network = tiny_reconstructor(2)
    network.card = CARD
    network.save(tmp_path / "first.safetensors")
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    settings = replace(settings, trainer=replace(settings.trainer, initial=str(tmp_path / "first.safetensors")))
    for data in ({"validate": "aces"}, {"calibrate": ["aces"]}):
        with pytest.raises(InputError, match=f"data.{next(iter(data))}: aces is among what trainer.initial was trained on"):
            train(replace(settings, data=replace(settings.data, **data)))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("site", [entry.name for entry in CATALOGUE.values() if entry.role == "test"])
def test_a_test_site_is_nothing_else(site):
    """METHOD 7: everything is chosen on other sites."""
    for key, parts in (("data.train", (["fr079", site], "csail", [])), ("data.validate", (["fr079"], site, []))):
        with pytest.raises(InputError, match=f"{key}: {site} is for tests alone"):
            check_roles(*parts)
    with pytest.raises(InputError, match=f"data.calibrate: {site} is for tests alone"):
        check_roles(["fr079"], "csail", [], [site])
    check_roles(["fr079"], "csail", [site, "aces"])


def test_what_weights_are_learned_on_is_neither_trained_nor_scored_on():
    check_roles(["fr079"], "csail", ["intel"], ["csail", "fr101"])
    with pytest.raises(InputError, match="data.calibrate: 'fr079' is also trained on"):
        check_roles(["fr079"], "csail", [], ["fr079"])
    with pytest.raises(InputError, match="data.test: aces is also trained or validated on"):
        check_roles(["fr079"], "csail", ["aces"], ["aces"])


@pytest.mark.parametrize(("trained", "scored"), [("drive", "drive/3.csv"), ("drive/3.csv", "drive"), ("drive", "drive/../drive/3.csv")])
def test_a_part_of_a_site_is_that_site(tmp_path, trained, scored):
    """A scan of a folder that is trained on has been seen."""
    (tmp_path / "drive").mkdir()
    for number in (3, 4):
        (tmp_path / f"drive/{number}.csv").write_text(f"{number} 1 2 3")
    (tmp_path / "drive2.csv").write_text("1 1 2 3")
    with pytest.raises(InputError, match="data.test: .* is also trained or validated on"):
        check_roles([str(tmp_path / trained)], "csail", [str(tmp_path / scored)])
    check_roles([str(tmp_path / trained)], "csail", [str(tmp_path / "drive2.csv")])
