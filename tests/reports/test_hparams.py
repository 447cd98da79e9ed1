import numpy as np
from reports_toys import result
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData
from torch.utils.tensorboard import SummaryWriter

from hilbertvae.reports.hparams import HEADLINES, headlines, write_hparams

CONFIG = {"case": "a", "seed": 3, "network": {"latent": 8, "channels": [4, 8]}, "trainer": {"learning_rate": 1e-3}, "data": {"folder": "x"}}


def row(folder):
    content = EventAccumulator(str(folder)).Reload().PluginTagToContent("hparams")
    start = HParamsPluginData.FromString(content["_hparams_/session_start_info"]).session_start_info
    experiment = HParamsPluginData.FromString(content["_hparams_/experiment"]).experiment
    return start.hparams, {info.name.tag for info in experiment.metric_infos}, content


def test_settings_and_headlines_make_a_row(tmp_path):
    found = result()
    with SummaryWriter(tmp_path) as writer:
        write_hparams(writer, CONFIG, found)
    settings, metrics, content = row(tmp_path)
    assert settings["network.latent"].number_value == 8 and settings["case"].string_value == "a"
    assert settings["network.channels"].string_value == "[4, 8]" and "data.folder" not in settings
    assert metrics == set(HEADLINES) and any("end" in tag for tag in content)
    events = EventAccumulator(str(tmp_path)).Reload()
    for tag, value in headlines(found).items():
        np.testing.assert_allclose(events.Scalars(tag)[0].value, value, rtol=1e-6)


def test_a_run_that_starts_names_its_columns(tmp_path):
    with SummaryWriter(tmp_path) as writer:
        write_hparams(writer, CONFIG)
    _, metrics, content = row(tmp_path)
    assert metrics == set(HEADLINES) and not any("end" in tag for tag in content)
    assert not EventAccumulator(str(tmp_path)).Reload().Tags()["scalars"]


def test_the_headline_is_the_runs_own_map():
    found = result()
    found.scores = {"nearest": found.scores["nearest"]}
    assert headlines(found)["headline/gaps_voxels_auc"] == np.mean(found.scores["nearest"]["voxels"]["gaps"]["auc"])
    found.scores = {
        "gap-centre": {"voxels": {"gaps": {"auc": [0.9, 0.9]}}},
        **found.scores,
    }  # which is told where gaps are, and competes nowhere
    assert headlines(found)["headline/gaps_voxels_auc"] == np.mean(found.scores["nearest"]["voxels"]["gaps"]["auc"])
    found.scores["cae-hm"] = {"voxels": {"gaps": {"auc": [0.25, 0.75], "best_f1": [0.5, 0.5]}}}
    found.scores["cae-hm-points"] = {"points": {"gaps": {"auc": [0.1, 0.2], "f1": [0.0, 0.0]}}}
    own = headlines(found)
    assert own["headline/gaps_voxels_auc"] == 0.5 and abs(own["headline/gaps_points_auc"] - 0.15) < 1e-12
