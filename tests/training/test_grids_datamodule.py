from dataclasses import replace

import numpy as np
import pytest
import torch
from training_toys import changed, name_of, tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.gaps import NoRoom
from hilbertvae.grids.training_grids import ClusteringSettings, training_grids
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.simulate import SCENES
from hilbertvae.training import grids_datamodule, kept_grids
from hilbertvae.training.grid_pairs import GridPairs
from hilbertvae.training.grids_datamodule import EpochBatches, GridsDataModule
from hilbertvae.training.kept_grids import draw_seed
from hilbertvae.training.settings import DataSettings
from toy_rooms import room_log


@pytest.fixture
def prepared(tmp_path):
    """Settings that train on one log and validate on another."""
    logs = [str(room_log(tmp_path / f"{name}.log", seed=seed)) for seed, name in enumerate(("train", "validate"))]
    data = DataSettings(train=logs[:1], validate=logs[1], test=[])
    return tiny_settings(tmp_path / "run", tmp_path / "cache", data, clustering=ClusteringSettings(2, [0.6, 1.2]))


def module_of(settings):
    module = GridsDataModule(settings)
    module.setup()
    return module


def draws_of(site, seed, settings):
    return draw_seed(settings.source().made_of(site), seed)


def whole(pairs):
    """(shown, target) of all of them."""
    return pairs[list(range(len(pairs)))]


def test_a_gpu_is_read_for_by_other_processes(prepared, monkeypatch):
    """Which read the same batches, in the same order; on a CPU nobody does."""
    alone = module_of(prepared).train_dataloader()
    assert alone.num_workers == 0
    monkeypatch.setattr(grids_datamodule, "training_device", lambda settings: "cuda")
    monkeypatch.setattr(grids_datamodule, "cores", lambda: 3)
    loader = module_of(prepared).train_dataloader()
    loader.pin_memory = False  # which takes a GPU
    assert loader.num_workers == 2
    for epoch in range(2):
        alone.sampler.set_epoch(epoch), loader.sampler.set_epoch(epoch)
        for batch, expected in zip(loader, alone, strict=True):
            assert all(torch.equal(*parts) for parts in zip(batch, expected, strict=True))


def test_nobody_reads_ahead_where_there_is_no_room_for_it(prepared, monkeypatch):
    """A container's shared memory holds no batches of many processes, which would be killed."""
    module = module_of(prepared)
    batch = prepared.trainer.batch_size * 2 * 16**2  # shown and target, int8
    monkeypatch.setattr(grids_datamodule, "training_device", lambda settings: "cuda")
    monkeypatch.setattr(grids_datamodule, "cores", lambda: 9)
    found = []
    for room in (0, 2 * 2 * batch - 1, 2 * 2 * batch, 1e12):
        monkeypatch.setattr(grids_datamodule, "_shared_bytes", lambda room=room: room)
        found.append(module.train_dataloader().num_workers)
    assert found == [0, 0, 1, grids_datamodule.MOST_READERS]


def test_grids_of_simulated_sites_are_not_those_of_older_scenes(prepared, monkeypatch):
    log = prepared.data.train[0]
    before = [name_of(site, 0, prepared) for site in ("simulated:7", log)]
    monkeypatch.setitem(SCENES, 2, 0)
    after = [name_of(site, 0, prepared) for site in ("simulated:7", log)]
    assert before[0] != after[0] and before[1] == after[1]


def test_pairs_are_those_of_each_clustering(prepared):
    module = module_of(prepared)
    log = prepared.data.train[0]
    draws = [draws_of(log, seed, prepared) for seed in range(2)]
    first = replace(prepared.clustering, turn=False)  # the site as it stands, once
    expected = [
        training_grids(read_carmen(log), 0.1, prepared.grid, clustering, draw)
        for clustering, draw in zip((first, prepared.clustering), draws, strict=True)
    ]
    for found, parts in zip(whole(module.train_pairs), zip(*expected, strict=True), strict=True):
        assert found.dtype == torch.int8
        np.testing.assert_array_equal(found.numpy(), np.concatenate(parts))


def test_every_site_draws_its_own(prepared, tmp_path):
    """Else all simulated sites would be turned by the same angle. The same log at another place draws the same."""
    log, other = prepared.data.train[0], prepared.data.validate
    draws = {draws_of(site, seed, prepared) for site in (log, other, "simulated:0", "simulated:1") for seed in range(3)}
    assert len(draws) == 12
    moved = tmp_path / "elsewhere.log"
    moved.write_bytes((tmp_path / "train.log").read_bytes())
    assert draws_of(str(moved), 1, prepared) == draws_of(log, 1, prepared)


def test_the_validation_site_is_seen_as_it_will_be_mapped(prepared):
    """Its clusterings are unturned, with gaps of one size; some of its grids are taken, each once."""
    module = module_of(prepared)
    unturned = replace(prepared.clustering, turn=False, gap_diameter_m=[prepared.validation_gap_m] * 2)
    scans = read_carmen(prepared.data.validate)
    expected = [training_grids(scans, 0.1, prepared.grid, unturned, seed) for seed in (1_000_001, 1_000_002)]
    every = {(s.tobytes(), t.tobytes()) for shown, target in expected for s, t in zip(shown, target, strict=True)}
    found = [(s.numpy().tobytes(), t.numpy().tobytes()) for s, t in zip(*whole(module.validation_pairs), strict=True)]
    assert len(found) == min(24, sum(len(shown) for shown, _ in expected)) and set(found) <= every


def test_a_site_without_room_for_gaps_is_named(prepared, monkeypatch):
    """Of hundreds, some of them simulated, with the clustering whose angle left no room."""

    def no_room(*_):
        raise NoRoom("gaps of 3 m: none fits")

    monkeypatch.setattr(kept_grids, "training_grids", no_room)
    with pytest.raises(InputError, match=r"\.log, clustering \d+: gaps of 3 m: none fits"):
        module_of(prepared)


def test_the_second_run_builds_nothing(prepared, monkeypatch):
    first = module_of(prepared)
    monkeypatch.setattr(kept_grids, "_build", lambda *arguments: pytest.fail("built again"))
    second = module_of(prepared)
    for name in ("train_pairs", "validation_pairs"):
        for before, after in zip(whole(getattr(first, name)), whole(getattr(second, name)), strict=True):
            assert torch.equal(before, after)
    first.setup("fit")  # nor does the same module, when Lightning asks again


def test_only_what_is_missing_is_built(prepared, monkeypatch):
    module_of(prepared)
    built = []
    original = kept_grids._build
    monkeypatch.setattr(
        kept_grids, "_build", lambda path, name, contents, seed, *_: built.append((name, seed)) or original(path, name, contents, seed, *_)
    )
    module_of(replace(prepared, clustering=replace(prepared.clustering, clusterings=3)))
    assert built == [(prepared.data.train[0], 2)]


def test_a_log_that_changed_is_read_again(prepared, tmp_path):
    before, _ = whole(module_of(prepared).train_pairs)
    room_log(tmp_path / "train.log", seed=7)
    after, _ = whole(module_of(prepared).train_pairs)
    assert before.shape != after.shape or not torch.equal(before, after)


def test_gaps_that_hide_nothing_would_choose_no_weights(prepared, monkeypatch):
    monkeypatch.setattr(GridsDataModule, "_hides", lambda self, pairs, number: False)
    with pytest.raises(InputError, match="validation_gap_m: expected gaps that hide a cell of some validation grid, got none"):
        module_of(prepared)


def test_a_pair_hides_what_is_known_of_its_target_alone(prepared):
    module = module_of(prepared)
    pairs = module.validation_pairs.dataset
    for number in range(len(pairs)):
        shown, target = pairs[[number]]
        assert module._hides(pairs, number) == any(s == 0 and t != 0 for s, t in zip(shown.flatten(), target.flatten(), strict=True))


def test_no_clusters_to_train_on(prepared):
    with pytest.raises(InputError, match="expected clusters to train and to validate on, got none; is grid.minimum_points too large"):
        module_of(changed(prepared, "grid.minimum_points", 10**6))


def batches(count=10, batch_size=4, steps=5, seed=0, epoch=0):
    sampler = EpochBatches(count, batch_size, steps, seed)
    sampler.set_epoch(epoch)
    return list(sampler)


def test_epochs_are_drawn_from_seed_and_epoch():
    assert batches() == batches()
    assert len({str(batches(epoch=epoch)) for epoch in range(4)} | {str(batches(seed=1))}) == 5


def test_a_batch_is_announced_a_step_before(prepared, monkeypatch):
    told, found = [], []
    monkeypatch.setattr(GridPairs, "announce", lambda self, chosen: told.append(chosen))
    sampler = module_of(prepared).train_dataloader().sampler
    for batch in sampler:
        assert len(told) == len(found) + 1
        found.append(batch)
    assert told == [*found[1:], []]


def test_an_epoch_has_the_steps_it_says_and_shows_every_grid_equally_often():
    found = batches()
    assert [len(batch) for batch in found] == [4] * 5 and len(EpochBatches(10, 4, 5, 0)) == 5
    np.testing.assert_array_equal(np.bincount(np.concatenate(found), minlength=10), 2)
    # Fewer places than grids: none twice.
    some = np.concatenate(batches(count=100, steps=3))
    assert len(set(some.tolist())) == 12 and some.max() < 100
    # More places than grids in one batch.
    assert [len(batch) for batch in batches(count=3, batch_size=7, steps=2)] == [7, 7]


def test_loaders(prepared):
    module = module_of(prepared)
    train = list(module.train_dataloader())
    assert [len(shown) for shown, _ in train] == [8] * 4
    validation = list(module.val_dataloader())
    np.testing.assert_array_equal(torch.cat([shown for shown, _ in validation]), whole(module.validation_pairs)[0])


def test_a_detailed_network_gets_details(prepared):
    plain = module_of(prepared)
    found = module_of(changed(prepared, "network.encoding", "detailed"))
    for name in ("train_pairs", "validation_pairs"):
        (ours, our_target), (theirs, their_target) = whole(getattr(found, name)), whole(getattr(plain, name))
        assert ours.shape[1] == 5 and torch.equal(ours[:, 0], theirs) and torch.equal(our_target, their_target)
        assert ours[:, 1:].any()


def test_targets_have_votes_where_the_likelihood_asks_for_them(prepared):
    plain = module_of(prepared)
    found = module_of(changed(changed(prepared, "network.encoding", "detailed"), "likelihood.vote_power", 0.5))
    (ours, our_target), (theirs, their_target) = whole(found.train_pairs), whole(plain.train_pairs)
    assert ours.shape[1] == 5 and our_target.shape[1] == 2
    assert torch.equal(ours[:, 0], theirs)
    assert torch.equal(our_target[:, 0], their_target) and our_target[:, 1].any()
