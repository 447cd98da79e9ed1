import copy
import os
import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest

from hilbertvae import site as site_module
from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud, points_cloud, voxel_cloud
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.simulate.building import BuildingSettings
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import REMEMBERED, Site, SiteSource, open_site, site_name
from hilbertvae.voxel_votes import voxel_index
from toy_rooms import carmen_line, room_log, square_room, write_log


def voxels_of(cloud, resolution_m):
    return [tuple(index) for index in voxel_index(cloud.points, resolution_m).tolist()]


def test_the_clouds_are_those_of_the_protocol(place):
    scans, resolution_m = place.scans, place.resolution_m
    assert resolution_m == {2: 0.1, 3: 0.2}[place.dimension]
    kept = scans.select(~scans.held_out())
    for cloud, expected in (
        (place.fit, fit_cloud(kept, resolution_m)),
        (place.whole, fit_cloud(scans, resolution_m)),
        (place.voxels, voxel_cloud(scans, resolution_m)),
        (place.points, points_cloud(scans, resolution_m, seed=0)[0]),
    ):
        np.testing.assert_array_equal(cloud.occupied, expected.occupied)
        np.testing.assert_array_equal(cloud.weight, expected.weight)
        np.testing.assert_allclose(cloud.points, expected.points, rtol=0, atol=1e-6)  # of means that are held off a side twice


def test_a_held_out_beam_leaves_nothing_in_what_mappers_are_given(place):
    """A return of a held-out beam in a voxel of its own is in no point of `fit`."""
    held_out = place.scans.held_out()
    alone = set(voxels_of(fit_cloud(place.scans.select(held_out), place.resolution_m), place.resolution_m))
    alone -= set(voxels_of(fit_cloud(place.scans.select(~held_out), place.resolution_m), place.resolution_m))
    assert alone and not alone & set(voxels_of(place.fit, place.resolution_m))
    assert alone <= set(voxels_of(place.whole, place.resolution_m))


def test_which_voxels_the_held_out_beams_saw(place):
    every = voxels_of(place.voxels, place.resolution_m)
    for mask, beams in ((place.voxels_held_out, place.scans.held_out()), (place.voxels_fitted, ~place.scans.held_out())):
        seen = set(voxels_of(voxel_cloud(place.scans.select(beams), place.resolution_m), place.resolution_m))
        np.testing.assert_array_equal(mask, [index in seen for index in every])
    assert (place.voxels_held_out | place.voxels_fitted).all()


def test_which_points_belong_to_held_out_beams(place):
    _, beam = points_cloud(place.scans, place.resolution_m)
    held_out = place.scans.held_out()
    np.testing.assert_array_equal(place.points_held_out, [held_out[k] for k in beam])
    assert place.points_held_out.mean() == pytest.approx(0.1, abs=0.02)


def test_beams_that_are_all_held_out_are_told_of(room):
    none = np.zeros(len(room.scans), np.int32)
    with pytest.raises(InputError, match="^scans: expected beams beside the held-out ones, got none; number the beams"):
        _ = Site("one beam", replace(square_room(), scan=none, beam=none)).fit


def test_another_resolution(room):
    coarse = Site("coarse", room.scans, 0.5)
    assert len(coarse.voxels) < len(room.voxels) / 5


def test_open_site_by_the_path_of_a_log(tmp_path):
    path = write_log(tmp_path / "attic.log.gz", [carmen_line(np.full(180, 2.0 + k), [k, 0, 0]) for k in range(3)])
    site = open_site(str(path))
    assert (site.name, site.dimension, len(site.scans)) == ("attic.log.gz", 2, 540)


def test_open_site_by_the_seed_of_a_simulated_building():
    pytest.importorskip("embreex")
    pytest.importorskip("shapely")
    building = BuildingSettings(scans=10, shortest_extent_m=12.0, longest_extent_m=14.0)
    first, again, other = (open_site(f"simulated:{seed}", source=SiteSource(building=building)) for seed in (5, 5, 6))
    assert first.name == "simulated:5"
    np.testing.assert_array_equal(first.scans.points, again.scans.points)
    assert len(first.scans) != len(other.scans) or (first.scans.points != other.scans.points).any()


def test_a_simulated_site_is_a_street_in_three_dimensions():
    pytest.importorskip("embreex")
    source = SiteSource(dimension=3, street=StreetSettings(scans=1, azimuths=100, max_range_m=15.0))
    site = open_site("simulated:3", source=source)
    assert (site.name, site.dimension, site.resolution_m) == ("simulated:3", 3, 0.2)
    assert np.abs(np.median(site.ground.height_above(site.scans.points))) < 1.0


@pytest.mark.parametrize("module", ["shapely", "trimesh", "trimesh.ray.ray_pyembree"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_simulated_site_without_its_extra_is_refused_before_anything_long_is_begun(module, dimension, monkeypatch):
    """As the one that a training of one's own logs is scored on by default."""
    pytest.importorskip("embreex")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"simulated sites need the extra 'sim'.*pip install 'hilbertvae\[sim\]'"):
        SiteSource(dimension).check("simulated:900002")


def test_scans_of_another_dimension_than_asked_for(tmp_path):
    path = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    with pytest.raises(InputError, match="attic.log.*expected 3D scans, as `dimension` says, got 2D"):
        open_site(str(path), source=SiteSource(dimension=3))


def test_a_site_of_the_catalogue_of_another_dimension_is_refused_before_it_is_read():
    with pytest.raises(InputError, match="intel.*expected 3D scans, as `dimension` says, got 2D"):
        SiteSource(dimension=3).check("intel")


def test_a_site_whose_file_has_a_name_in_another_encoding(tmp_path):
    """A run's tables and pictures can't be written under it."""
    assert site_name(str(tmp_path / os.fsdecode(b"B\xfcro.npz"))) == "B?ro.npz"
    assert site_name(str(tmp_path / "Büro.npz")) == "Büro.npz"


def test_a_path_that_can_t_be_read_is_refused_before_anything_long_is_begun(tmp_path):
    np.savez(tmp_path / "cloud.npz", points=np.zeros((4, 3)))
    with pytest.raises(InputError, match="sensor_origin_m"):
        SiteSource(dimension=3).check(str(tmp_path / "cloud.npz"))


def test_what_is_remembered_is_made_once(room):
    made = []
    site = Site("room", room.scans)
    for _ in range(2):
        assert site.remember(("key", 1), lambda: made.append(1) or "value") == "value"
    assert site.remember(("key", 2), lambda: "other") == "other" and made == [1]


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("simulated:", "expected simulated:<seed>"),
        ("simulated:-1", "expected simulated:<seed>"),
        ("simulated:²", "expected simulated:<seed>"),
        ("intell", "'intell': not in the catalogue"),
        ("attic.log", "attic.log: no such file"),
    ],
)
def test_references_to_nothing_are_named(tmp_path, monkeypatch, reference, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        SiteSource().scans(reference)


def test_a_site_remembers_what_was_asked_for_last():
    made, site = [], Site("room", square_room())

    def ask(key):
        return site.remember(key, lambda: made.append(key) or key)

    for key in range(REMEMBERED):
        assert ask(key) == key
    ask(0)
    assert made == list(range(REMEMBERED))
    ask("one more")  # 1 is the one that was not asked for the longest
    ask(0)
    assert made == [*range(REMEMBERED), "one more"]
    ask(1)
    assert made[-1] == 1


def test_a_path_is_read_once_while_its_files_stay_as_they_are(tmp_path, monkeypatch):
    log, read = room_log(tmp_path / "room.log"), []
    monkeypatch.setattr(site_module, "read_scans_path", lambda *how: read.append(how) or read_scans_path(*how))
    source = SiteSource()
    first = source.scans(str(log))
    source.check(str(log))
    assert source.scans(str(log)) is first and len(read) == 1
    room_log(log, seed=3)
    assert len(source.scans(str(log))) != len(first) or not np.array_equal(source.scans(str(log)).points, first.points)
    assert len(read) == 2
    SiteSource(reading=ReadingSettings(every=2)).scans(str(log))
    assert len(read) == 3


def test_a_drive_is_read_again_once_scans_in_a_linked_folder_have_changed(tmp_path):
    store, drive = tmp_path / "store", tmp_path / "drive"
    store.mkdir()
    drive.mkdir()
    (drive / "velodyne").symlink_to(store)
    (drive / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    for points in (50, 90):
        np.full((points, 4), 3.0, dtype="<f4").tofile(store / "000000.bin")
        assert len(SiteSource(3).scans(str(drive)).points) == points


def test_a_copy_of_a_site_is_the_same_site(place):
    for copied in (pickle.loads(pickle.dumps(place)), copy.deepcopy(place)):
        assert (copied.name, copied.resolution_m) == (place.name, place.resolution_m)
        np.testing.assert_array_equal(copied.fit.points, place.fit.points)
        assert copied.remember("a", lambda: 1) == 1
    assert len({place, copy.copy(place)}) == 2 and place != copy.copy(place)


def test_a_path_is_a_reference_and_what_was_read_there_stays_as_it_is(tmp_path):
    path = room_log(tmp_path / "room.log")
    first = open_site(path)
    with pytest.raises(ValueError, match="read-only"):
        first.scans.points[:] += 5
    np.testing.assert_array_equal(open_site(str(path)).scans.points, first.scans.points)


@pytest.mark.parametrize("dimension", [4, "3"])
def test_another_dimension_than_the_two_is_refused(dimension):
    with pytest.raises(InputError, match="^dimension: expected 2 or 3, got"):
        SiteSource(dimension)
