"""`hilbertvae-train` with networks that it did not train: what they bring with them counts, and is what the result says."""

import re
from dataclasses import replace

import pytest
from composed_settings import key_of, settings_of
from hydra import initialize_config_dir
from warm_start import train

from hilbertvae.checks import InputError
from hilbertvae.commands.configuration import CONF
from hilbertvae.commands.overrides import refuse_ignored, refuse_of_one_name
from hilbertvae.commands.run import identity, run
from hilbertvae.drawing.canvas import new_figure
from hilbertvae.files import file_sha256
from hilbertvae.mappers.weights import occupied_weight_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.result_json import read_result
from hilbertvae.training.learned_as import KEY
from toy_rooms import tiny_reconstructor


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return tiny_reconstructor().save(tmp_path_factory.mktemp("given") / "network.safetensors")


def fast(folder, *overrides):
    pytest.importorskip("embreex")
    small = ["debug=fast", "pictures=false", "evaluation.occlusion=false", "trainer.threads=1"]
    return settings_of(*small, f"output={folder / 'run'}", f"data.cache={folder / 'cache'}", *overrides)


def test_the_result_says_what_grid_and_network_were_scored(tmp_path, network):
    assert run(fast(tmp_path, f"checkpoint={network}", "mapper=[cvae-hm]")) == 0
    found, about = read_result(tmp_path / "run/result.json")
    given = tiny_reconstructor()
    assert about["config"]["grid"]["cells"] == given.grid.cells != fast(tmp_path).grid.cells
    assert about["config"]["network"]["channels"] == given.network_settings.channels
    assert about["data"]["checkpoint"] == file_sha256(network)


def test_sites_that_a_given_network_has_not_seen_are_none_of_its(tmp_path, network, monkeypatch):
    """Those that the run would be trained and validated on; but where its map learns weights anew, it is there."""
    monkeypatch.setattr(
        "hilbertvae.reports.report.contact_sheet", lambda sites: shown.append([role for _, role in sites]) or new_figure(1, 1)
    )
    for words, roles in (((), ["test"]), (("+mapper.cvae-hm.neighbours=3",), ["validate", "test"])):
        shown = []
        assert run(fast(tmp_path, f"checkpoint={network}", "mapper=[cvae-hm]", "pictures=true", *words)) == 0
        assert shown == [roles]


def test_the_result_says_of_a_network_what_its_card_says_and_not_what_nobody_read(tmp_path):
    """Two recipes scored with the same words would else be one in a table."""
    given = tiny_reconstructor()
    given.card = {"recipe_hash": "a", "seed": 5, "trained_on": ["hall"], KEY: {"calibration_seeds": [7]}}
    given.map_weights = Reconstructor.load("2d").map_weights
    given.save(tmp_path / "given.safetensors")
    assert run(fast(tmp_path, f"checkpoint={tmp_path / 'given.safetensors'}", "mapper=[cvae-hm]")) == 0
    about = read_result(tmp_path / "run/result.json")[1]
    assert about["card"] == given.card and about["seeds"] == {"training": 5, "gaps": [0], "calibration": [7]}
    config = about["config"]
    assert not {"augmentation", "clustering", "trained"} & {*config} and not {"train", "simulated"} & {*config["data"]}
    assert {*config["trainer"]} == {"threads", "accelerator"}
    assert config["calibration_occupied_weight"] == occupied_weight_of(given.map_weights)


def test_a_training_s_folder_is_not_scored_into_with_another_network(tmp_path, network):
    own, settings = tmp_path / "run", fast(tmp_path, f"checkpoint={network}", "mapper=[cvae-hm]")
    trained = tiny_reconstructor(seed=1)
    trained.card = {"training_hash": "abc", "seed": 7}
    trained.save(own / "model.safetensors")
    (own / "training.json").write_text('{"training_hash": "abc"}')
    with pytest.raises(InputError, match="output: .*run holds a training, whose results would be replaced"):
        run(settings)
    named = ["mapper=[cvae-hm]", "+mapper.cvae-hm.weights=unit", "mapper.cvae-hm.reconstructor="]
    with pytest.raises(InputError, match="output: .*run holds the training of another network than `mapper.cvae-hm.reconstructor`"):
        run(fast(tmp_path, *named[:2], named[2] + str(network)))
    assert not (own / "result.json").exists()
    assert run(fast(tmp_path, *named[:2], f"{named[2]}{own / 'model.safetensors'}")) == 0
    before = (own / "result.json").read_bytes()
    again = fast(tmp_path, f"checkpoint={own / 'model.safetensors'}", "mapper=[cvae-hm]", "seed=3")
    with pytest.raises(InputError, match="output: .*run holds a training, whose results would be replaced; choose another `name`"):
        run(again)
    assert (own / "result.json").read_bytes() == before
    again.output = str(tmp_path / "again")
    assert run(again) == 0
    about = read_result(tmp_path / "again" / "result.json")[1]
    assert about["seeds"]["training"] == 7  # not what was typed


@pytest.mark.parametrize("word", ["grid.inner_radius_m=3", "start=random", "grid.start=random", "network=gated_wide", "++network.latent=8",
                                  "likelihood.kind=signed", "calibration_occupied_weight=1"])  # fmt: skip
def test_what_a_network_brings_with_it_is_not_set_beside_it(network, word):
    settings = settings_of(f"checkpoint={network}")
    with pytest.raises(InputError, match=f"^{key_of(word)}: expected none beside checkpoint=.*, which has its own"):
        refuse_ignored(settings, ["name=again", word])
    refuse_ignored(settings, ["name=again", "experiment=real_2d", "mapper=[cvae-hm]", "evaluation.occlusion=false"])
    refuse_ignored(settings_of(), [word])


def test_two_mappers_of_one_name_are_refused():
    """They would be one row, of either's settings."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        for words in (["mapper=[hm,hm-3d]"], ["mapper=[hm-3d,nearest,hm]"], ["experiment=real_3d", "mapper=[hm-3d,hm]"]):
            with pytest.raises(InputError, match="mapper: expected mappers of different names, got hm.* and hm.*, both called hm$"):
                refuse_of_one_name(words)
        refuse_of_one_name(["mapper=[hm,hm,hm-points-3d,nearest]", "seed=0"])


def test_two_mappers_of_one_name_are_refused_wherever_they_are_chosen(tmp_path):
    """By an experiment, and of files of one's own."""
    (tmp_path / "experiment").mkdir()
    (tmp_path / "mapper").mkdir()
    (tmp_path / "mapper/hm2.yaml").write_text((CONF / "mapper/hm.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "experiment/mine.yaml").write_text("# @package _global_\ndefaults: [override /mapper: [hm, hm2]]\n", encoding="utf-8")
    for word in ("mapper=[hm,hm2]", "experiment=mine"):
        done = train(tmp_path, word, "debug=fast", "--config-dir", str(tmp_path))  # options may come last
        assert done.returncode == 2 and "got hm and hm2, both called hm" in done.stderr
    (tmp_path / "mapper/hm2.yaml").rename(tmp_path / "mapper/hm.yaml")
    done = train(tmp_path, "-cd", str(tmp_path), "mapper=[hm]", "debug=fast")
    assert done.returncode == 2 and "hm.yaml: hilbertvae has its own mapper/hm.yaml" in done.stderr
    assert not (tmp_path / "outputs").exists()


def test_a_network_file_that_does_not_say_its_kind_is_refused(tmp_path):
    (tmp_path / "network").mkdir()
    (tmp_path / "network/tiny.yaml").write_text("channels: [8, 16, 24]\n", encoding="utf-8")
    done = train(tmp_path, "--config-dir", str(tmp_path), "network=tiny", "debug=fast")
    assert done.returncode == 2 and re.search(r"network: its file needs `defaults: \[...\]` .*gated_schema", done.stderr)
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize("word", ["trainer.epochs=5", "++trainer.learning_rate=1", "clustering.clusterings=2", "augmentation.balls=3",
                                  "trainer={epochs: 5}", "augmentation={balls: 3}", "clustering={turn: false}",
                                  "data.train=[simulated:4]",
                                  "data.simulated=9", "data={simulated_first: 9}", "trained=outputs/trained"])  # fmt: skip
def test_how_networks_are_trained_is_not_said_beside_one(network, word):
    settings = settings_of(f"checkpoint={network}")
    with pytest.raises(InputError, match=f"^{key_of(word)}: expected none beside checkpoint=.*, which was trained before"):
        refuse_ignored(settings, ["name=again", word])
    refuse_ignored(settings, ["trainer.threads=2", "trainer={accelerator: cpu}", "trainer=ddp", "debug=fast"])  # how maps are made, too
    refuse_ignored(settings_of("data.train=[aces]"), [word])


@pytest.mark.parametrize(("word", "words", "with_some"), [
    ("clustering.clusterings=2", [], ["data.train=[aces]"]), ("clustering={clusterings: 2}", [], ["data.train=[aces]"]),
    ("data.simulated_first=9", ["data.train=[aces]", "data.simulated=0"], []),
    ("data.simulated_clusterings=1", ["data.train=[aces]", "data.simulated=0"], []),
    ("data.reading.max_range_m=9", [], ["data.test=[./own.log]"]), ("data={reading: {every: 2}}", [], ["data.validate=./own.log"]),
])  # fmt: skip
def test_settings_of_sites_that_a_run_has_none_of_are_not_typed(word, words, with_some):
    with pytest.raises(InputError, match=rf"^{key_of(word)}\S*: expected none with"):
        refuse_ignored(settings_of(*words), ["name=again", word])
    refuse_ignored(settings_of(*with_some), ["name=again", word])


@pytest.mark.parametrize(("word", "other"), [("data.simulated_scans=5", 3), ("data={simulated_variety: wide}", 3),
                                             ("++data.simulated_extent_m=[12, 16]", 3), ("data.street.variety=wide", 2)])  # fmt: skip
def test_sites_of_another_dimension_are_not_described(word, other):
    words = ["experiment=real_2d", "data.simulated=9", word, "debug=fast"]  # which has some of either
    with pytest.raises(InputError, match=f"^{key_of(word)}: expected none with dimension={other}, where simulated sites are "):
        refuse_ignored(replace(settings_of(), dimension=other), words)
    refuse_ignored(replace(settings_of(), dimension=5 - other), words)


@pytest.mark.parametrize("word", ["validation_gap_m=1", "calibration_seeds=[7]", "calibration_given=map",
                                  "data.calibrate=[simulated:900050]", "data={calibrate: [simulated:900050]}"])  # fmt: skip
def test_how_weights_are_learned_counts_for_maps_that_learn_them(network, word):
    for usual in ([], ["mapper=[cvae-hm]"]):  # baselines of the default list have radii of their own, and no network
        with pytest.raises(InputError, match=f"^{key_of(word)}: expected none beside checkpoint=.*, which has its map's weights"):
            refuse_ignored(settings_of(f"checkpoint={network}", *usual), [word])
    refuse_ignored(settings_of(f"checkpoint={network}", "mapper=[cvae-hm]", "+mapper.cvae-hm.neighbours=3"), [word])
    refuse_ignored(settings_of("mapper=[cvae-hm]"), [word])


@pytest.mark.parametrize("words", [["network=paper_32", "grid.cells=32"], ["network.known=false"], ["likelihood.kind=gaussian"]])
def test_a_network_that_can_t_learn_from_a_site_is_told_of_before_its_training(tmp_path, words):
    with pytest.raises(InputError, match="^mapper.cvae-hm-adapted: adapt_steps: expected a network that answers with logits and says"):
        run(fast(tmp_path, "mapper=[cvae-hm-adapted]", *words))
    assert not (tmp_path / "run/model.safetensors").exists()


@pytest.mark.parametrize("word", ["flips=3", "neighbours=0", "weights=foo", "calibration=pixels", "device=hope", "inner_radius_m=-1",
                                  "inner_radius_m=9", "resolution_m=abc", "reconstructor=5", "reconstructor=[2d]",
                                  "reconstructor=gone.safetensors", "reconstructor=3d"])  # fmt: skip
def test_what_no_map_can_have_is_said_before_a_training(tmp_path, word):
    key, value = word.split("=")
    mappers = ["mapper=[cvae-hm,cvae-hm-points]", f"++mapper.cvae-hm.{word}"]  # the other one wants a training
    settings = settings_of("debug=fast", f"output={tmp_path / 'run'}", *mappers)
    with pytest.raises(
        InputError, match=f"(?i)^mapper.cvae-hm.{key}: .*expected .*{value.strip('[]')}|^mapper.cvae-hm.{key}: {value}: no such"
    ):
        run(settings)
    assert not (tmp_path / "run").exists()


def test_a_network_trained_where_another_was_scored_has_curves_of_its_own(tmp_path, network):
    for words in ([f"checkpoint={network}"], []):
        assert run(fast(tmp_path, "mapper=[cvae-hm]", *words)) == 0
        assert len(list((tmp_path / "run/tensorboard").glob("events*"))) <= 2
        values = scalars(tmp_path / "run/tensorboard", "headline/gaps_voxels_auc")
        assert len(values) == 1


def scalars(folder, tag):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder))
    events.Reload()
    return events.Scalars(tag)


def test_voxels_of_another_size_than_the_network_s_are_refused(tmp_path, network):
    with pytest.raises(InputError, match="resolution_m: expected 0.1, as the network of mapper.cvae-hm was trained with, got 0.2"):
        run(fast(tmp_path, f"checkpoint={network}", "mapper=[cvae-hm]", "resolution_m=0.2"))


def test_a_run_is_another_when_the_network_of_a_mapper_is(tmp_path):
    path = tmp_path / "network.safetensors"
    settings = fast(tmp_path, "mapper=[cvae-hm]", f"mapper.cvae-hm.reconstructor={path}")
    missing = identity(settings)
    tiny_reconstructor(seed=0).save(path)
    first = identity(settings)
    assert run(settings) == 0
    assert read_result(tmp_path / "run/result.json")[1]["data"]["mapper.cvae-hm.reconstructor"] == file_sha256(path)
    tiny_reconstructor(seed=1).save(path)
    assert missing != first != identity(settings)


def test_a_mapper_s_network_that_is_not_there_is_named(tmp_path):
    settings = fast(tmp_path, "mapper=[cvae-hm]", f"mapper.cvae-hm.reconstructor={tmp_path}/gone.safetensors")
    with pytest.raises(InputError, match="^mapper.cvae-hm.reconstructor: .*gone.safetensors: no such checkpoint"):
        run(settings)


def test_raw_grids_lie_in_the_boxes_of_the_only_network_that_is_named(tmp_path, network):
    """As they do in those of `checkpoint`, and as the result says."""
    words = ["mapper=[cvae-hm,raw-grid-hm]", "+mapper.cvae-hm.weights=unit"]
    for name, more in (("run", [f"mapper.cvae-hm.reconstructor={network}"]), ("given", [f"checkpoint={network}"])):
        settings = fast(tmp_path, *words, *more)
        settings.output = str(tmp_path / name)
        assert run(settings) == 0
    (named, about), (given, _) = (read_result(tmp_path / name / "result.json") for name in ("run", "given"))
    assert named.scores == given.scores
    assert about["config"]["grid"]["cells"] == tiny_reconstructor().grid.cells != settings.grid.cells


def test_what_named_networks_bring_with_them_is_not_set_beside_them(network):
    """As beside `checkpoint`, but where one is trained as well."""
    alone = ["mapper=[cvae-hm,raw-grid-hm]", f"mapper.cvae-hm.reconstructor={network}"]
    said = {"trainer.learning_rate=7": "was trained before", "network=gated_wide": "has its own", "grid.cells=32": "has its own"}
    for word, why in (said | {"calibration_seeds=[7]": "has its map's weights"}).items():
        with pytest.raises(InputError, match=f"^{key_of(word)}: expected none beside mapper.cvae-hm.reconstructor=.*, which {why}"):
            refuse_ignored(settings_of(*alone), [*alone, word])
        refuse_ignored(settings_of("mapper=[cvae-hm,cvae-hm-points]", alone[1]), [word])
    settings_of(*alone, "data.train=[fr079]", "data.test=[fr079]").check()  # on what it was trained its card says
    several = settings_of("mapper=[cvae-hm,cvae-hm-points]", alone[1], "mapper.cvae-hm-points.reconstructor=2d")
    refuse_ignored(several, ["grid.cells=32"])  # of maps of raw grids
    with pytest.raises(InputError, match="^network.latent: expected none beside"):
        refuse_ignored(several, ["network.latent=3"])


@pytest.mark.parametrize(("overrides", "expected"), [((), 0.1), (("dimension=3",), 0.2), (("dimension=3", "resolution_m=0.4"), 0.4)])
def test_voxels_are_those_of_the_dimension_unless_given(overrides, expected):
    assert settings_of(*overrides).resolution_m == expected


def test_where_maps_are_filled_makes_no_other_run():
    """A sweep that goes on elsewhere has its results; those of before are found under the hash that they have."""
    usual, cpu, turned = (identity(settings_of("mapper=[cvae-hm,hm]", *more)) for more in ([], ["device=cpu"], ["flips=1"]))
    assert usual == cpu != turned and usual["mapper"] == settings_of("mapper=[cvae-hm,hm]").mapper
