"""What names a file of training grids: all that they depend on, and nothing else."""

from dataclasses import asdict

import pytest
from training_toys import changed, name_of, tiny_settings

from hilbertvae.grids.frame import FrameSettings
from hilbertvae.training.kept_grids import VALIDATION_SEEDS

MATTER = [
    ("resolution_m", 0.2),
    ("grid.cells", 8),
    ("grid.cluster_diameter_m", 2.0),
    ("grid.inner_radius_m", 0.4),
    ("grid.start", "random"),
    ("grid.minimum_points", 9),
    ("grid.occupied_share", 0.5),
    ("grid.frame", FrameSettings(centre="median")),
    ("grid.frame", FrameSettings(rotation="full")),
    ("grid.frame", FrameSettings(scale="extent")),
    ("clustering.gap_diameter_m", [1.0, 1.2]),
    ("clustering.gap_diameter_m", []),
    ("clustering.turn", False),
    ("clustering.mapped_share", 0.5),
    ("data.simulated_scans", 21),
    ("data.simulated_variety", "wide"),
    ("data.simulated_extent_m", [12, 17]),
    ("network.encoding", "detailed"),
    ("likelihood.vote_power", 0.5),
]


DO_NOT = [
    ("name", "other"),
    ("output", "elsewhere"),
    ("seed", 5),
    ("data.cache", "elsewhere"),
    ("data.simulated", 9),
    ("clustering.clusterings", 9),
    ("trainer.learning_rate", 1.0),
    ("trainer.batch_size", 3),
    ("augmentation.balls", 0),
    ("network.latent", 9),
    ("evaluation.gap_ratio", 1.0),
]


@pytest.mark.parametrize(("key", "value"), MATTER, ids=lambda part: str(part)[:40])
def test_the_hash_sees_what_changes_grids(key, value):
    settings = tiny_settings("run", "cache")
    assert name_of("simulated:0", 1, changed(settings, key, value)) != name_of("simulated:0", 1, settings)


@pytest.mark.parametrize(("key", "value"), DO_NOT, ids=lambda part: str(part)[:40])
def test_the_hash_does_not_see_what_leaves_grids_alone(key, value):
    settings = tiny_settings("run", "cache")
    other = changed(settings, key, value)
    assert asdict(other) != asdict(settings)
    assert name_of("simulated:0", 1, other) == name_of("simulated:0", 1, settings)


def test_the_hash_sees_site_and_clustering():
    settings = tiny_settings("run", "cache")
    names = [("simulated:0", 1), ("simulated:0", 2), ("simulated:1", 1), ("intel", 1), ("csail", 1)]
    assert len({name_of(*name, settings) for name in names}) == len(names)


@pytest.mark.parametrize(("share", "same"), [(0.0, True), (0.5, True), (1.0, False)])
def test_the_validation_site_is_a_map_where_all_training_sites_are(share, same):
    settings = tiny_settings("run", "cache")
    other = changed(settings, "clustering.mapped_share", share)
    for seed in VALIDATION_SEEDS:
        assert (name_of("simulated:1", seed, other) == name_of("simulated:1", seed, settings)) is same
