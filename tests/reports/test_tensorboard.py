from dataclasses import replace

import numpy as np
from reports_toys import result
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.tensorboard import SummaryWriter

from hilbertvae.drawing.canvas import pixels
from hilbertvae.reports.score_pictures import precision_recall_picture
from hilbertvae.reports.tensorboard import write_tensorboard


def test_scores_pictures_and_settings_are_read_back(tmp_path):
    found = result()
    with SummaryWriter(tmp_path) as writer:
        write_tensorboard(writer, found, {"score/curves": pixels(precision_recall_picture(found))}, {"model": {"lr": 1e-3}})
    events = EventAccumulator(str(tmp_path)).Reload()
    tags = events.Tags()
    (scalar,) = events.Scalars(f"score/{found.site}/nearest/voxels/gaps/auc")
    np.testing.assert_allclose(scalar.value, np.mean(found.scores["nearest"]["voxels"]["gaps"]["auc"]), rtol=1e-6)
    assert tags["images"] == ["score/curves"]
    (image,) = events.Images("score/curves")
    assert image.width > 500 and image.encoded_image_string.startswith(b"\x89PNG")
    config = events.Tensors("config/text_summary")[0].tensor_proto.string_val[0].decode()
    assert all(line.startswith("    ") for line in config.splitlines()) and '"lr": 0.001' in config
    assert "| nearest |" in events.Tensors(f"{found.site}/scores/text_summary")[0].tensor_proto.string_val[0].decode()


def test_two_test_sites_of_a_run_lie_side_by_side(tmp_path):
    with SummaryWriter(tmp_path) as writer:
        for site in ("simulated:2", "simulated:3"):
            write_tensorboard(writer, replace(result(), site=site))
    events = EventAccumulator(str(tmp_path)).Reload()
    for site in ("simulated_2", "simulated_3"):
        assert len(events.Scalars(f"score/{site}/nearest/voxels/gaps/auc")) == 1
        assert len(events.Tensors(f"{site}/scores/text_summary")) == 1
