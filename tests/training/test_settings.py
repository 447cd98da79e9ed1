from dataclasses import replace

import pytest

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.grids.frame import FrameSettings
from hilbertvae.grids.training_grids import ClusteringSettings
from hilbertvae.reconstruction.settings import AugmentationSettings, LikelihoodSettings
from hilbertvae.scoring.protocol import Protocol
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.training.settings import DataSettings, Settings, TrainerSettings


def good():
    return Settings(data=DataSettings(train=["aces", "fhw"], validate="csail", test=["intel"]))


def test_good_settings_pass():
    good().check()
    Settings(data=DataSettings(simulated=3)).check()


def test_simulated_sites_follow_the_first():
    settings = Settings(data=DataSettings(simulated=3, simulated_first=1600))
    assert settings.simulated_sites() == ["simulated:1600", "simulated:1601", "simulated:1602"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dimension": 4}, "dimension: expected 2 or 3, got 4"),
        ({"resolution_m": 0.0}, "resolution_m: expected a positive number, got 0.0"),
        ({"grid": GridSettings(cells=0)}, "grid.cells: expected at least 2"),
        ({"grid": GridSettings(cells=32.5)}, "grid.cells: expected a whole number"),
        ({"grid": GridSettings(cells="32")}, "grid.cells: expected a whole number"),
        ({"clustering": ClusteringSettings(clusterings=-3), "data": DataSettings(simulated=3)}, "clustering.clusterings: expected"),
        ({"grid": GridSettings(minimum_points=-5)}, "grid.minimum_points: expected a whole number"),
        ({"grid": GridSettings(start="forgy")}, "grid.start: expected one of quick_means, ask_means,"),
        ({"evaluation": Protocol(gap_seeds=[])}, "evaluation.gap_seeds"),
        ({"data": DataSettings()}, "data.train: expected at least one site, or data.simulated buildings, got neither"),
        ({"data": DataSettings(train=["aces"], validate="aces")}, "data.validate: 'aces' is also trained on"),
        (
            {"data": DataSettings(train=["aces"], validate="csail", test=["aces", "intel"])},
            "data.test: aces is also trained or validated on",
        ),
        ({"data": DataSettings(train=["aces"], validate="csail", test=["csail"])}, "data.test: csail is also trained or validated on"),
        ({"data": DataSettings(simulated=3, validate="simulated:2")}, "data.validate: 'simulated:2' is also trained on"),
        ({"data": DataSettings(simulated=3, test=["simulated:0"])}, "data.test: simulated:0 is also trained or validated on"),
        (
            {"dimension": 3, "data": DataSettings(simulated=1, simulated_variety="wide")},
            "data.simulated_variety: expected usual in 3D",
        ),
        ({"data": DataSettings(simulated=1, street=StreetSettings(variety="wide"))}, "data.street.variety: expected usual in 2D"),
        ({"trainer": TrainerSettings(epochs=0)}, "trainer.epochs: expected a positive number, got 0"),
        ({"trainer": TrainerSettings(steps_per_epoch=0)}, "trainer.steps_per_epoch"),
        ({"trainer": TrainerSettings(batch_size=-4)}, "trainer.batch_size"),
        ({"trainer": TrainerSettings(learning_rate=float("nan"))}, "trainer.learning_rate"),
        ({"trainer": TrainerSettings(optimizer="adam")}, "trainer.optimizer"),
        ({"trainer": TrainerSettings(validation_grids=0)}, "trainer.validation_grids"),
        ({"trainer": TrainerSettings(kl_warmup_share=0.1)}, "trainer.kl_warmup_share: expected a share from 0.2 to 1, got 0.1"),
        ({"trainer": TrainerSettings(initial="gone.safetensors")}, "trainer.initial: expected a model.safetensors, or one of 2d, 3d, "),
        ({"trainer": TrainerSettings(warmup_share=3.0)}, "trainer.warmup_share: expected a share in"),
        ({"trainer": TrainerSettings(free_nats=-1.0)}, "trainer.free_nats: expected a number from 0 on, got -1"),
        ({"trainer": TrainerSettings(patience_epochs=-1)}, "trainer.patience_epochs"),
        ({"trainer": TrainerSettings(threads=-1)}, "trainer.threads"),
        ({"clustering": ClusteringSettings(clusterings=0)}, "clustering.clusterings: expected a whole number of at least 1, got 0"),
        ({"data": DataSettings(simulated=3, simulated_clusterings=0)}, "data.simulated_clusterings: expected a whole number"),
        ({"data": DataSettings(simulated=-2)}, "data.simulated: expected a number from 0 on, got -2"),
        ({"data": DataSettings(simulated=2, simulated_first=-1)}, "data.simulated_first: expected a number from 0 on, got -1"),
        ({"data": DataSettings(simulated=9, simulated_first=900000)}, "data.validate: 'simulated:900001' is also trained on"),
        ({"task": "clustering", "data": DataSettings(simulated=1, test=[])}, "data.test: expected a site whose returns are clustered"),
        ({"trainer": TrainerSettings(accelerator="gpo")}, "trainer.accelerator: expected one of auto, cpu, gpu, cuda, mps, got 'gpo'"),
        ({"calibration_seeds": []}, "calibration_seeds: expected one or more different seeds from 0 on"),
        ({"calibration_seeds": [-1]}, "calibration_seeds"),
        ({"calibration_given": "maps"}, "calibration_given: expected one of scans, map, fine-map, got 'maps'"),
        ({"calibration_occupied_weight": 0.0}, "calibration_occupied_weight: expected a positive number, got 0.0"),
        ({"calibration_occupied_weight": 1e300}, "calibration_occupied_weight: expected from 0.001 to 1000"),
        ({"trainer": TrainerSettings(kl_warmup_share=3.0)}, "trainer.kl_warmup_share: expected a share from 0.2 to 1, got 3.0"),
        ({"trainer": TrainerSettings(gradient_clip=-1.0)}, "trainer.gradient_clip: expected a number from 0 on"),
        ({"trainer": TrainerSettings(gradient_clip=float("inf"))}, "^trainer.gradient_clip: expected a finite number, got inf"),
        ({"trainer": TrainerSettings(kl_warmup_share=float("nan"))}, "^trainer.kl_warmup_share: expected a finite number, got nan"),
        ({"augmentation": AugmentationSettings(ball_diameter_cells=[1.0, float("inf")])}, r"^augmentation.*cells\[1\]: expected"),
        ({"mapper": {"cvae-hm": {"ridge": float("inf")}}}, "^mapper.cvae-hm.ridge: expected a finite number"),
        ({"trainer": TrainerSettings(precision="bf16-true")}, "trainer.precision: expected one of auto, 32-true, bf16-mixed"),
        ({"trainer": TrainerSettings(threads=100_000)}, "trainer.threads: expected at most 1024"),
        ({"flips": 3}, "flips: expected 1, 2, 4 or 8, got 3"),
    ],
)
def test_settings_that_make_no_run_are_named(change, message):
    with pytest.raises(InputError, match=message):
        replace(good(), **change).check()


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: LikelihoodSettings(known_weight=-3.0), "likelihood.known_weight"),
        (lambda: LikelihoodSettings(observed_weight=float("nan")), "likelihood.observed_weight"),
        (lambda: AugmentationSettings(balls=-1), "augmentation.balls"),
    ],
)
def test_settings_of_parts_are_named_as_they_are_made(make, key):
    with pytest.raises(InputError, match=f"{key}: expected a number from 0 on"):
        make()


@pytest.mark.parametrize("sizes", [[3.5], [3.5, 1.5], [0.0, 1.5]])
def test_gaps_of_no_range(sizes):
    with pytest.raises(InputError, match="clustering.gap_diameter_m: expected the smallest and the largest, or an empty list"):
        ClusteringSettings(gap_diameter_m=sizes)


def test_spellings_of_a_path_are_one_site(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = DataSettings(train=["drives/monday"], validate="csail", test=["./drives/tuesday/../monday/"])
    with pytest.raises(InputError, match="data.test: .*monday/ is also trained or validated on"):
        replace(good(), data=data).check()


def test_a_network_that_is_given_may_be_scored_where_others_are_trained():
    """What it was trained on its card says (`check_unseen`)."""
    data = DataSettings(train=["fr079"], simulated=3, validate="simulated:2", test=["simulated:0"])
    Settings(data=data, checkpoint="2d").check()
    with pytest.raises(InputError, match="data.test: simulated:2 is also trained or validated on"):
        Settings(data=replace(data, test=["simulated:2"]), checkpoint="2d").check()


def test_test_sites_of_one_name_would_overwrite_each_other():
    data = DataSettings(train=["fr079"], validate="csail", test=["a/00", "b/00"])
    with pytest.raises(InputError, match="data.test: expected sites of different names"):
        replace(good(), data=data).check()


def test_test_sites_have_no_names_that_a_run_has_folders_of():
    data = DataSettings(train=["fr079"], validate="csail", test=["drives/pictures", "drives/monday"])
    replace(good(), data=data).check()  # the first one's result lies in the run's folder itself
    with pytest.raises(InputError, match="data.test: expected another name than pictures for"):
        replace(good(), data=replace(data, test=data.test[::-1])).check()


def test_the_voxel_follows_the_dimension():
    assert (Settings(dimension=2).resolution_m, Settings(dimension=3).resolution_m) == (0.1, 0.2)
    assert Settings(dimension=3, resolution_m=0.1).resolution_m == 0.1


def test_the_folder_follows_the_name():
    assert (Settings(name="mine").output, Settings(name="other").output) == ("outputs/mine", "outputs/other")
    assert Settings(name="mine", output="elsewhere").output == "elsewhere"


def test_how_simulated_buildings_are_read():
    data = DataSettings(simulated_scans=20, simulated_extent_m=[12, 16], folder="logs", download=True)
    source = replace(good(), data=data).source()
    assert (source.dimension, source.folder, source.download) == (2, "logs", True)
    building = source.building
    assert (building.scans, building.shortest_extent_m, building.longest_extent_m) == (20, 12, 16)


def test_buildings_that_differ_otherwise_are_named():
    with pytest.raises(InputError, match="data.simulated_variety: expected one of usual, wide, got 'wild'"):
        replace(good(), data=DataSettings(train=["aces"], simulated_variety="wild")).check()
    assert Settings(data=DataSettings(simulated_variety="wide")).source().building.variety == "wide"


def test_a_row_of_a_network_is_named_as_one():
    """By its name tables know which rows to compare with which, and whose training costs what."""
    for name in ("cvae-hm-wide", "cae-hm"):
        replace(good(), mapper={name: {"reconstructor": "trained"}, "raw": {"reconstructor": None}, "gone": None}).check()
    with pytest.raises(InputError, match="^mapper.big-hm: expected a name that begins with cvae-"):
        replace(good(), mapper={"big-hm": {"reconstructor": "2d"}}).check()


def test_cells_much_smaller_than_voxels_are_told_of(recwarn):
    for resolution_m, of_extent in ((0.1, False), (0.16, False), (0.2, True)):
        frame = FrameSettings(scale="extent") if of_extent else FrameSettings()
        replace(good(), resolution_m=resolution_m, grid=GridSettings(frame=frame)).check()
    assert not recwarn.list
    with pytest.warns(UserWarning, match="^grid.cells: cells of 0.1 m in voxels of 0.2 m, of which most stay unknown"):
        replace(good(), resolution_m=0.2).check()


@pytest.mark.parametrize("extent", [[5.0, 9.0], [16.0, 12.0], [12.0], [12.0, 1e6]])
def test_simulated_buildings_have_a_length_that_can_be_scanned(extent):
    with pytest.raises(InputError, match="data.simulated_extent_m: expected two lengths from 6 to 1000"):
        replace(good(), data=DataSettings(train=["aces"], simulated_extent_m=extent)).check()
