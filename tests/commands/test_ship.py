"""A network becomes one that comes with the package, in a folder of its own."""

import re
from dataclasses import replace

import numpy as np
import pytest

import hilbertvae
from hilbertvae.commands import ship
from hilbertvae.commands.ship import main
from hilbertvae.reconstruction import shipped
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.result_json import write_result
from hilbertvae.scoring.protocol import Protocol, evaluate
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.training.learned_as import KEY, learned_as
from hilbertvae.training.settings import DataSettings, Settings
from toy_rooms import tiny_reconstructor

CARD = {"trained_on": ["fr079", "2 simulated buildings"], "validated_on": "toy", "epoch": 3, "steps": 40, "seed": 0,
        "command": ["hilbertvae-train", "name=toy"], "git": {"commit": "0123456789", "dirty": False}}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch, room):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    monkeypatch.setattr(ship, "open_site", lambda *where: room)
    return tmp_path / "weights"


@pytest.fixture
def trained(tmp_path):
    made = tiny_reconstructor(seed=3)
    made.card = {**CARD, "started_from": {**CARD, "trained_on": ["aces"], "command": ["hilbertvae-train", "name=before"]}}
    return made.save(tmp_path / "model.safetensors")


def test_a_shipped_network_is_loaded_by_its_name(folder, trained, room):
    assert main(["2d", "--checkpoint", str(trained)]) == 0
    mapper = hilbertvae.load_mapper("2d", neighbours=5)
    weights = mapper.reconstructor.map_weights
    assert weights.keys() == {"points", "voxels"} and mapper.reconstructor.card["trained_on"] == CARD["trained_on"]
    assert (folder / "2d.safetensors").stat().st_size < trained.stat().st_size
    found = mapper.fit(room.fit.points, room.fit.occupied, room.fit.weight).predict_proba(room.fit.points)
    assert np.isfinite(found).all() and found[room.fit.occupied, 1].mean() > found[~room.fit.occupied, 1].mean()


def test_maps_may_be_turned_and_read_otherwise_than_in_training(folder, trained):
    assert main(["2d", "--checkpoint", str(trained), "--rotation", "spread", "--interpolated"]) == 0
    first = Reconstructor.load("2d")
    assert (first.grid.frame.rotation, first.grid.interpolated) == ("spread", True)
    assert "in frames turned as `spread`, read between cells; in" in (folder / "2d.md").read_text()
    # What is packed already can be shipped again, to the bit.
    assert main(["2d", "--checkpoint", "2d"]) == 0
    again = Reconstructor.load("2d")
    assert again.fingerprint() == first.fingerprint() and again.map_weights == first.map_weights and again.grid == first.grid


def test_maps_for_one_reading_alone_may_be_read_between_cells(folder, trained):
    """Weights for the other are what they are without."""
    learned = {}
    for how in ([], ["--interpolated"], ["--interpolated", "voxels"]):
        assert main(["2d", "--checkpoint", str(trained), "--rotation", "spread", *how]) == 0
        learned[tuple(how[1:]) or bool(how)] = Reconstructor.load("2d").map_weights
    assert Reconstructor.load("2d").grid.interpolated == "voxels"
    assert "those for voxels read between cells; in" in (folder / "2d.md").read_text()
    unseen = {how: {reading: weights["unseen"] for reading, weights in found.items()} for how, found in learned.items()}
    assert unseen["voxels",]["points"] == unseen[False]["points"] != unseen[True]["points"]
    assert unseen["voxels",]["voxels"] == unseen[True]["voxels"] != unseen[False]["voxels"]


def test_where_the_cuts_on_points_lie_is_chosen_and_kept(folder, trained, capsys):
    assert main(["2d", "--checkpoint", str(trained)]) == 0
    first = Reconstructor.load("2d").map_weights
    assert main(["2d", "--checkpoint", "2d", "--occupied-weight", "1.2"]) == 0
    shy = Reconstructor.load("2d").map_weights
    assert (first["points"]["occupied_weight"], shy["points"]["occupied_weight"]) == (2.0, 1.2)
    assert shy["voxels"] == first["voxels"] and shy["points"] != first["points"]
    assert "an occupied one counts for 1.2." in (folder / "2d.md").read_text()
    assert main(["2d", "--checkpoint", "2d"]) == 0 and Reconstructor.load("2d").map_weights == shy
    assert main(["2d", "--checkpoint", "2d", "--occupied-weight", "0"]) == 2
    assert main(["2d", "--checkpoint", "2d", "--occupied-weight", "1e300"]) == 2
    assert "--occupied-weight: expected a positive number" in capsys.readouterr().err and Reconstructor.load("2d").map_weights == shy


def test_what_another_network_learned_may_be_added(folder, trained, tmp_path):
    """Its trainings are in the card, and the map's weights are learned anew where those of the checkpoint were."""
    before = replace(tiny_reconstructor(seed=5), card={**CARD, "trained_on": ["9 simulated buildings from 7 on"]})
    after = {**CARD, "trained_on": ["5 simulated buildings from 16 on"], "started_from": before.card}
    paths = [
        before.save(tmp_path / "before.safetensors"),
        replace(tiny_reconstructor(seed=6), card=after).save(tmp_path / "after.safetensors"),
    ]
    assert main(["2d", "--checkpoint", str(trained), "--plus", *map(str, paths), "--plus", *map(str, paths)]) == 0
    made, base, *others = (Reconstructor.load(path).network.state_dict() for path in ("2d", trained, *paths))
    for name, weight in made.items():
        wanted = base[name] + 2 * (others[1][name] - others[0][name])
        assert (weight - wanted).abs().max() <= 0.02 * wanted.abs().max()
    assert Reconstructor.load("2d").card["calibrated_on"] == ["toy"]
    card = (folder / "2d.md").read_text()
    assert "3. On 5 simulated buildings from 16 on" in card and "4. What step 3 changed is added once more." in card
    assert card.count("What this changed in the network that it trained is added") == 1 and "On 9 simulated" not in card
    assert main(["2d", "--checkpoint", str(trained), "--plus", *map(str, paths[::-1])]) == 2


def test_a_packed_network_says_nearly_the_same(folder, trained):
    main(["2d", "--checkpoint", str(trained)])
    grids = np.random.default_rng(0).integers(-1, 2, (4, 16, 16)).astype(np.int8)
    whole, packed = (Reconstructor.load(path).reconstruct(grids) for path in (trained, "2d"))
    assert np.abs(whole - packed).max() < 0.05 * np.abs(whole).max()
    assert (whole != packed).any()


def test_the_card_says_what_there_is_to_know(folder, trained, room, tmp_path):
    main(["2d", "--checkpoint", str(trained)])
    result = evaluate(hilbertvae.load_mapper("2d"), room, Protocol(gap_seeds=[0, 1], gap_ratio=0.2, occlusion=False), "cvae-hm")
    path = write_result(
        tmp_path / "result.json", result, {"command": ["hilbertvae-train", "checkpoint=2d"], "git": {"commit": "abcdefabcd"}}
    )
    assert main(["2d", "--results", str(path)]) == 0
    text = (folder / "2d.md").read_text()
    for said in (
        "1. On aces, best weights by toy: epoch 3, step 40, seed 0, by `hilbertvae-train name=before` at commit 0123456.",
        "2. On fr079, 2 simulated buildings",
        "by `hilbertvae-train name=toy`",
        f"| {room.name} | gaps | voxels |",
        "`hilbertvae-train checkpoint=2d` at commit abcdefa",
        "over gap seeds of 1 m;",
        "states no terms for the data",
    ):
        assert said in text, said
    assert main(["2d"]) == 0 and "Not scored yet." in (folder / "2d.md").read_text()


def test_what_learned_from_simulated_sites_alone_is_free(folder, tmp_path):
    made = tiny_reconstructor()
    made.card = {**CARD, "trained_on": ["60 simulated buildings"], "validated_on": "simulated:900001"}
    assert main(["2d-sim", "--checkpoint", str(made.save(tmp_path / "model.safetensors"))]) == 0
    assert "nobody's scans are in it" in (folder / "2d-sim.md").read_text()


def test_weights_of_a_map_may_be_learned_on_several_sites(folder, trained, monkeypatch, room, capsys):
    opened = []
    monkeypatch.setattr(ship, "open_site", lambda reference, *where: (opened.append(reference), room)[1])
    assert main(["2d", "--checkpoint", str(trained), "--calibrate", "csail", "simulated:900001"]) == 0
    assert opened == ["csail", "simulated:900001"] == Reconstructor.load("2d").card["calibrated_on"]
    assert "The Hilbert Map's weights were learned on csail, simulated:900001, over" in (folder / "2d.md").read_text()
    assert main(["2d", "--checkpoint", "2d"]) == 0 and opened[2:] == opened[:2]  # as its card says
    assert main(["2d", "--checkpoint", str(trained), "--calibrate", "aces"]) == 2
    assert "--calibrate: aces is among what the network was trained on" in capsys.readouterr().err


def test_of_several_sites_fewer_gap_seeds_may_do(folder, trained, monkeypatch, capsys):
    learned, learn = [], ship.learn_rank_weights
    monkeypatch.setattr(ship, "learn_rank_weights", lambda *given, **how: (learned.append(how["seeds"]), learn(*given, **how))[1])
    assert main(["2d", "--checkpoint", str(trained), "--calibration-seeds", "7", "8"]) == 0
    assert learned == [[7, 8]] and Reconstructor.load("2d").card[KEY]["calibration_seeds"] == [7, 8]
    assert main(["2d", "--checkpoint", "2d"]) == 0 and learned[1] == [7, 8]  # as its card says
    assert main(["2d", "--checkpoint", str(trained), "--calibration-seeds", "7", "7"]) == 2
    assert "--calibration-seeds: expected one or more different seeds from 0 on, got [7, 7]" in capsys.readouterr().err


def test_a_network_for_maps_has_weights_that_are_learned_on_maps(folder, trained, monkeypatch):
    learned, learn = [], ship.learn_rank_weights
    monkeypatch.setattr(ship, "learn_rank_weights", lambda *sites, **how: (learned.append(how["given"]), learn(*sites, **how))[1])
    assert main(["2d", "--checkpoint", str(trained), "--calibration-given", "map"]) == 0
    assert learned == ["map"] and Reconstructor.load("2d").card[KEY]["calibration_given"] == "map"
    card = (folder / "2d.md").read_text()
    assert ", given a map, over" in card and "of scans, which tell more, one for scans makes more" in card
    assert main(["2d", "--checkpoint", "2d"]) == 0 and learned[1] == "map"  # as its card says
    with pytest.raises(SystemExit, match="2"):
        main(["2d", "--checkpoint", "2d", "--calibration-given", "maps"])


def test_simulated_sites_are_made_as_in_the_training(folder, tmp_path, monkeypatch, room, capsys):
    told = Settings(data=DataSettings(simulated_scans=20), validation_gap_m=1.5, calibration_seeds=[7])
    sources, learned = [], []
    monkeypatch.setattr(ship, "open_site", lambda reference, resolution_m, source: (sources.append(source), room)[1])
    learn = ship.learn_rank_weights
    monkeypatch.setattr(ship, "learn_rank_weights", lambda *what, **how: (learned.append(how), learn(*what, **how))[1])
    made = tiny_reconstructor(seed=3)
    for card, settings, said in ((CARD | {KEY: learned_as(told)}, told, "as in its training"), (CARD, Settings(), "by defaults")):
        made.card = card
        assert main(["2d", "--checkpoint", str(made.save(tmp_path / "model.safetensors"))]) == 0
        assert sources.pop() == settings.source() and learned.pop() == settings.calibration()
        assert f"2d: its map's weights are learned on toy, {said}" in capsys.readouterr().out


@pytest.mark.parametrize("dimension", [2, 3])
def test_simulated_sites_may_be_of_another_variety_than_in_the_training(folder, tmp_path, monkeypatch, room, box, capsys, dimension):
    told = Settings(dimension=dimension, data=DataSettings(street=StreetSettings(scans=3, variety="everywhere")))
    sources, made, name = [], tiny_reconstructor(seed=3, dimension=dimension), f"{dimension}d"
    monkeypatch.setattr(
        ship, "open_site", lambda reference, resolution_m, source: (sources.append(source), room if dimension == 2 else box)[1]
    )
    made.card = CARD | {KEY: learned_as(told)}
    checkpoint = str(made.save(tmp_path / "model.safetensors"))
    assert main([name, "--checkpoint", checkpoint, "--calibration-variety", "wide"]) == 0
    wide = {2: told.source().building, 3: told.source().street}[dimension]
    assert {2: sources[0].building, 3: sources[0].street}[dimension] == replace(wide, variety="wide")
    assert main([name, "--checkpoint", name]) == 0 and sources[1] == sources[0]  # as its card says
    assert main([name, "--checkpoint", checkpoint, "--calibration-variety", "narrow"]) == 2
    assert "--calibration-variety: " in capsys.readouterr().err


def test_what_can_not_be_shipped(folder, tmp_path, capsys):
    assert main(["2d", "--checkpoint", str(tmp_path / "gone.safetensors")]) == 2
    assert "gone.safetensors: no such checkpoint" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["4d", "--checkpoint", str(tmp_path)])
    assert not folder.exists()


def test_the_mean_of_a_network_and_what_was_made_of_it(folder, trained, tmp_path, capsys):
    assert main(["2d", "--checkpoint", str(trained)]) == 0
    before = Reconstructor.load("2d")
    after = tiny_reconstructor(seed=4)
    after.card = {**CARD, "started_from": before.card}
    assert main(["2d", "--checkpoint", str(after.save(tmp_path / "after.safetensors")), "--mean"]) == 0
    found, old, new = (network.network.state_dict() for network in (Reconstructor.load("2d"), before, after))
    for key, value in found.items():
        np.testing.assert_allclose(value, (old[key] + new[key]) / 2, atol=0.02 * float(new[key].abs().max() + old[key].abs().max()))
    assert "2. On fr079, 2 simulated buildings" in (text := (folder / "2d.md").read_text())
    assert text.count("the mean of these weights and those of the step before") == 1
    after.card["started_from"] = {**CARD, "started_from": Reconstructor.load("2d").card}
    assert main(["2d", "--checkpoint", str(after.save(tmp_path / "two_on.safetensors")), "--mean"]) == 0
    steps = re.findall(r"^(\d)\. (.*)$", (folder / "2d.md").read_text(), re.MULTILINE)
    assert steps[-1][1].endswith(f"What comes out is the mean of these weights and those of step {int(steps[-1][0]) - 2}.")
    other = tiny_reconstructor(latent=5)
    other.card = CARD
    assert main(["2d", "--checkpoint", str(other.save(tmp_path / "other.safetensors")), "--mean"]) == 2
    assert "checkpoint: expected a network of (2, " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "data", "sites", "said"),
    [
        ("3d", DataSettings(street=StreetSettings(variety="wide")), ["simulated:7"], " (streets of wide variety)"),
        ("3d", DataSettings(street=StreetSettings(variety="wide")), ["hall"], ""),
        ("3d", DataSettings(street=StreetSettings(variety="everywhere")), ["simulated:7"], " (streets and floors)"),
        ("3d", DataSettings(simulated_variety="wide"), ["simulated:7"], ""),
        ("2d", DataSettings(simulated_variety="wide"), ["simulated:7"], " (buildings of wide variety)"),
        ("2d", DataSettings(), ["simulated:7"], ""),
        ("2d", None, ["simulated:7"], ""),
    ],
)
def test_simulated_sites_that_weights_were_learned_on_are_told_where_they_are_not_as_usual(folder, name, data, sites, said):
    made = tiny_reconstructor(int(name[0]), seed=3)
    made.card = {**CARD, "flips": 1, "calibrated_on": sites, **({} if data is None else {KEY: learned_as(Settings(data=data))})}
    folder.mkdir(exist_ok=True)
    made.save(folder / f"{name}.safetensors")
    ship.write_card(name, [])
    assert f"weights were learned on {sites[0]}{said}, over 1 flip" in (folder / f"{name}.md").read_text()


@pytest.mark.parametrize(
    ("sites", "said"),
    [
        (["hall", "5 simulated streets and floors from 3 on"], "rooms were learned from, and tried in, simulation alone"),
        (["tall floors", "5 simulated streets"], "rooms have been tried in simulation alone"),
    ],
)
def test_a_card_says_whether_floors_are_among_what_was_learned_from(folder, sites, said):
    made = tiny_reconstructor(3, seed=3)
    made.card = {**CARD, "flips": 1, "trained_on": sites, "started_from": CARD}
    folder.mkdir(exist_ok=True)
    made.save(folder / "3d.safetensors")
    ship.write_card("3d", [])
    assert said in (folder / "3d.md").read_text()
