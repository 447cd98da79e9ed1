import shutil

import numpy as np
import pytest
from hilbert_map_toys import fit
from sklearn.base import clone

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud, fit_cloud
from hilbertvae.grids.cluster_grids import GridSettings, bin_grids
from hilbertvae.mappers import completing_mapper
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from hilbertvae.reconstruction import adaptation
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.site import Site
from toy_rooms import box_room, tiny_grid, tiny_reconstructor


def queries_of(place, count=300):
    low, high = place.fit.points.min(axis=0), place.fit.points.max(axis=0)
    return np.random.default_rng(0).uniform(low, high, (count, place.dimension))


def test_a_map_whose_network_learned_from_the_site(place):
    network = tiny_reconstructor(place.dimension)
    plain, learned = fit(HilbertMap(network), place.fit), fit(HilbertMap(network, adapt_steps=2), place.fit)
    queries = queries_of(place)
    assert plain.adapted_ is None
    assert learned.adapted_.fingerprint() != network.fingerprint()
    assert (plain.predict_proba(queries) != learned.predict_proba(queries)).any()
    same = fit(HilbertMap(learned.adapted_), place.fit)
    np.testing.assert_array_equal(same.predict_proba(queries), learned.predict_proba(queries))
    again = fit(clone(learned), place.fit)
    np.testing.assert_array_equal(again.predict_proba(queries), learned.predict_proba(queries))
    back = fit(learned.set_params(adapt_steps=0), place.fit)
    assert back.adapted_ is None
    np.testing.assert_array_equal(back.predict_proba(queries), plain.predict_proba(queries))


@pytest.mark.parametrize(("steps", "clusterings"), [(1, 1), (10_000, completing_mapper.MOST_CLUSTERINGS)])
def test_as_many_clusterings_as_steps_need(room, monkeypatch, steps, clusterings):
    seen = []

    def learn(network, shown, target, *how):
        seen.append((shown, target))
        return network

    monkeypatch.setattr(adaptation, "adapted", learn)
    monkeypatch.setattr(adaptation, "batch_size", lambda grid, dimension: 5)
    mapper = fit(HilbertMap(tiny_reconstructor(), adapt_steps=steps), room.fit)
    ((shown, target),) = seen
    assert len(shown) == len(target)
    assert len(shown) == 5 if clusterings == 1 else len(shown) > 4 * len(mapper.frames_)
    assert ((shown == 0) & (target != 0)).any()


def test_it_learns_from_grids_of_the_map_s_own(room, monkeypatch):
    """Boxes of fewer and larger cells than the network's: gaps as large in metres, more of them in a box, and batches of as many cells."""
    network, steps, original = tiny_reconstructor(), [], adaptation.augment
    grid = GridSettings(cells=8, cluster_diameter_m=6.4, inner_radius_m=0.5, minimum_points=3)
    monkeypatch.setattr(adaptation, "BATCH_CELLS", 2**9)
    monkeypatch.setattr(adaptation, "augment", lambda shown, *how: steps.append((shown, *how[1:])) or original(shown, *how))
    fit(HilbertMap(network, weights="unit", grid=grid, adapt_steps=3), room.fit)
    assert len(steps) == 3
    for shown, settings, dimension in steps:
        assert shown.shape == (8, 8, 8) and dimension == 2
        np.testing.assert_allclose(np.multiply(settings.ball_diameter_cells, grid.cell_m), adaptation.GAP_DIAMETER_M)
        assert settings.balls == round(6.4**2 / adaptation.BALLS_AREA_M2)


def test_it_goes_on_with_the_network_that_learned(room, tmp_path):
    mapper = fit(HilbertMap(tiny_reconstructor(), adapt_steps=2), room.fit)
    path, kept = save_map(mapper, tmp_path / "site.map"), mapper.adapted_.save(tmp_path / "model.safetensors")
    found, queries = load_map(path, checkpoint=kept), queries_of(room)
    assert found.adapt_steps == 0
    np.testing.assert_array_equal(found.predict_proba(queries), mapper.predict_proba(queries))
    part = room.fit.select(slice(200))
    for each in (mapper, found):
        each.partial_fit(part.points, part.occupied, part.weight)
    np.testing.assert_array_equal(found.predict_proba(queries), mapper.predict_proba(queries))
    with pytest.raises(InputError, match="does not come with this version.* is not in .*adapted.safetensors"):
        load_map(path).partial_fit(part.points, part.occupied, part.weight)
    learned = fit(found.set_params(adapt_steps=1), room.fit)
    assert learned.adapted_.fingerprint() != mapper.adapted_.fingerprint()


def test_a_loaded_map_takes_the_network_that_learned_along(room, tmp_path):
    """Where it is saved, it can grow, unless another map's network is there."""
    mapper, part = fit(HilbertMap(tiny_reconstructor(), adapt_steps=2), room.fit), room.fit.select(slice(200))
    folders = [tmp_path / name for name in ("first", "second", "taken")]
    for folder in folders:
        folder.mkdir()
    save_map(mapper, folders[0] / "map.safetensors")
    mapper.adapted_.save(folders[0] / "adapted.safetensors")
    for folder in folders[:2]:  # where it lies nothing is to be done
        save_map(load_map(folders[0]), folder / "map.safetensors")
    queries = queries_of(room)
    again = load_map(folders[1]).partial_fit(part.points, part.occupied, part.weight)
    np.testing.assert_array_equal(
        again.predict_proba(queries), mapper.partial_fit(part.points, part.occupied, part.weight).predict_proba(queries)
    )
    others = tiny_reconstructor(seed=1).save(folders[2] / "adapted.safetensors").read_bytes()
    with pytest.warns(UserWarning, match="taken/adapted.safetensors: holds another network than the map's.*checkpoint='.*first"):
        save_map(load_map(folders[0]), folders[2] / "map.safetensors")
    assert (folders[2] / "adapted.safetensors").read_bytes() == others
    shutil.copy(folders[2] / "adapted.safetensors", folders[0])  # no longer the map's: what is there isn't taken along
    save_map(load_map(folders[0]), tmp_path / "map.safetensors")
    assert not (tmp_path / "adapted.safetensors").exists()


@pytest.mark.parametrize("steps", [-1, 1.5, True, "many"])
def test_steps_that_are_no_number_of_steps(room, steps):
    with pytest.raises(InputError, match="adapt_steps: expected a whole number of at least 0"):
        fit(HilbertMap(tiny_reconstructor(), adapt_steps=steps), room.fit)


def test_where_nothing_can_be_learned(room):
    with pytest.raises(InputError, match="adapt_steps: expected a network that can learn, got raw grids"):
        fit(HilbertMap(grid=tiny_grid(), adapt_steps=1), room.fit)
    with pytest.raises(InputError, match="adapt_steps: expected 0 with weights=cluster"):
        fit(HilbertMap(tiny_reconstructor(), weights="cluster", adapt_steps=1), room.fit)
    with pytest.raises(InputError, match="adapt_steps: expected 0 without fill"):
        fit(HilbertMap(tiny_reconstructor(), fill=False, adapt_steps=1), room.fit)
    with pytest.raises(InputError, match="adapt_steps: expected 0 to begin a map with partial_fit"):
        HilbertMap(tiny_reconstructor(), adapt_steps=1).partial_fit(room.fit.points, room.fit.occupied)


@pytest.mark.parametrize("raw", [False, True])
def test_boxes_are_completed_in_portions_as_in_one_go(place, monkeypatch, raw):
    network = None if raw else tiny_reconstructor(place.dimension)
    monkeypatch.setattr(completing_mapper, "BATCH", 2)
    whole, reports = fit(HilbertMap(network), place.fit), []
    monkeypatch.setattr(completing_mapper, "SHOWN_BYTES", 1)
    mapper = HilbertMap(network)
    mapper.progress = lambda done, count: reports.append((done, count))
    portions, count = fit(mapper, place.fit), len(whole.frames_)
    assert count > 4
    np.testing.assert_array_equal(portions.grids_, whole.grids_)
    if raw:
        assert portions.known_ is None
    else:
        np.testing.assert_array_equal(portions.known_, whole.known_)
        assert reports == [(min(done, count), count) for done in range(2, count + 2, 2)]


def test_large_boxes_are_completed_fewer_at_a_time(place, monkeypatch):
    """A network holds its levels of a whole batch."""
    network, batches, original = tiny_reconstructor(place.dimension), [], Reconstructor.complete
    monkeypatch.setattr(Reconstructor, "complete", lambda *given, **named: batches.append(named["batch"]) or original(*given, **named))
    for cells, batch in ((16**place.dimension * 3, 3), (16**place.dimension - 1, 1), (2**21, 64)):
        monkeypatch.setattr(completing_mapper, "BATCH_CELLS", cells)
        fit(HilbertMap(network), place.fit)
        assert set(batches) == {batch}
        batches.clear()


def test_a_site_too_small_to_cut_gaps_from_leaves_the_network_as_it_is():
    points, occupied = np.array([[0.0, 1.0], [0.0, 0.5], [0.0, 0.2]]), np.array([True, False, False])
    network = tiny_reconstructor()
    with pytest.warns(UserWarning, match="adapt_steps: the site is too small to cut gaps from"):
        mapper = HilbertMap(network, adapt_steps=2).fit(points, occupied)
    assert mapper.adapted_ is network
    np.testing.assert_array_equal(mapper.predict_proba(points), HilbertMap(network).fit(points, occupied).predict_proba(points))


@pytest.mark.parametrize("resolution_m", [None, 0.4])
def test_raw_grids_have_cells_as_large_as_voxels(resolution_m):
    """A street's voxels are of 0.2 m; in cells of 0.1 m seven of eight would stay unknown."""
    cloud = box_room().select(np.s_[::7])
    site = Site("room", cloud, resolution_m or 0.2)
    mapper = fit(HilbertMap(evidence=False, resolution_m=resolution_m), site.fit)
    assert mapper.grid_.cell_m == mapper.evidence_.resolution_m == site.resolution_m


FINER = 10


def occupied_share(shown):
    """Of the known cells that a network was shown."""
    shown = np.concatenate(shown)
    return (shown == 1).sum() / (shown != 0).sum()


@pytest.mark.parametrize("learned", [False, True])
def test_a_network_is_shown_as_many_walls_in_finer_voxels(room, monkeypatch, learned):
    """A beam leaves a free sample in each of them, ten in the cell of a grid, and one return."""
    network, shown = tiny_reconstructor(), []
    if learned:
        monkeypatch.setattr(adaptation, "adapted", lambda network, given, target, *rest: shown.extend([given, target]) or network)
    else:
        complete = Reconstructor.complete
        monkeypatch.setattr(
            Reconstructor, "complete", lambda self, grids, *how, **named: shown.append(grids) or complete(self, grids, *how)
        )
    shares = []
    for resolution_m in (network.resolution_m, network.resolution_m / FINER):
        fit(HilbertMap(network, resolution_m=resolution_m, adapt_steps=int(learned)), fit_cloud(room.scans, resolution_m))
        shares.append(occupied_share(shown))
        shown.clear()
    assert shares[1] == pytest.approx(shares[0], rel=0.2)


def test_a_map_of_finer_voxels_grows_as_it_is_fitted(room):
    network, resolution_m = tiny_reconstructor(), 0.1 / FINER
    cloud = fit_cloud(room.scans, resolution_m)
    mapper = HilbertMap(network, resolution_m=resolution_m)
    for part in (slice(0, None, 2), slice(1, None, 2)):
        scan = cloud.select(part)
        mapper.partial_fit(scan.points, scan.occupied, scan.weight)
    counted = Cloud(cloud.points, cloud.occupied, np.where(cloud.occupied, 1.0, 1 / FINER) * cloud.weight)
    expected = network.complete(bin_grids(counted, mapper.frames_, network.grid), mapper.flips_)
    assert np.abs(mapper.grids_.astype(float) - expected.value).mean() < 1e-3
