import hashlib
import http.server
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.files import file_sha256
from hilbertvae.scans import sites
from hilbertvae.scans.beam_origins import find_beam_origins
from hilbertvae.scans.sites import CATALOGUE, data_folder, find_site, read_site, site_path
from toy_rooms import carmen_line, write_log


@pytest.fixture
def log(tmp_path):
    """A small log, and a catalogue in which it is the site `toy`."""
    ranges = np.linspace(1, 5, 180)
    return write_log(tmp_path / "toy-corrected.log.gz", [carmen_line(ranges, [k, 0, 0]) for k in range(4)])


@pytest.fixture
def toy(monkeypatch, log):
    entry = replace(CATALOGUE["intel"], name="toy", file=log.name, sha256=hashlib.sha256(log.read_bytes()).hexdigest())
    monkeypatch.setitem(sites.CATALOGUE, "toy", entry)
    return entry


@pytest.fixture
def address(log):
    """A server on the loopback that hands out the log's folder."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=log.parent)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


def put(log, folder):
    target = folder / "2d" / log.name
    target.parent.mkdir(parents=True)
    target.write_bytes(log.read_bytes())
    return target


def test_a_site_that_is_there_is_read(toy, log, tmp_path):
    put(log, tmp_path / "data")
    scans = read_site("toy", tmp_path / "data")
    assert len(scans) == 4 * 180
    assert np.linalg.norm(scans.points - scans.origins, axis=1).max() == pytest.approx(5.0)


def test_a_site_is_read_as_the_catalogue_says(toy, monkeypatch, log, tmp_path):
    put(log, tmp_path / "data")
    monkeypatch.setitem(sites.CATALOGUE, "toy", replace(toy, every=2, max_range_m=3.0))
    scans = read_site("toy", tmp_path / "data")
    assert set(scans.origins[:, 0]) == {0.0, 2.0}
    assert np.linalg.norm(scans.points - scans.origins, axis=1).max() < 3.0


def test_a_log_whose_hash_differs(toy, log, tmp_path):
    path = put(log, tmp_path / "data")
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(InputError, match=f"site 'toy'.*has sha256 {file_sha256(path)}, expected {toy.sha256}"):
        site_path("toy", tmp_path / "data")


def test_a_site_that_is_not_there_says_how_to_get_it(toy, tmp_path):
    with pytest.raises(InputError, match="site 'toy'.*not there; set HILBERTVAE_DATA .* data.download=true"):
        site_path("toy", tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_a_name_that_is_not_in_the_catalogue():
    with pytest.raises(InputError, match="site 'intell': not in the catalogue; expected one of .*intel"):
        find_site("intell")


def test_a_path_of_that_name_is_said_to_need_a_dot(tmp_path, monkeypatch):
    (tmp_path / "kitti").mkdir()
    (tmp_path / "scan").touch()
    monkeypatch.chdir(tmp_path)
    for name, kind in (("kitti", "folder"), ("scan", "file")):
        with pytest.raises(InputError, match=rf"site '{name}': not in the catalogue; .*, or ./{name} for the {kind} here$"):
            find_site(name)
    for name in ("intell", "n" * 5000, "\0"):
        with pytest.raises(InputError, match="single_rellis_os1_000104$"):
            find_site(name)


def test_download(toy, log, tmp_path, address):
    path = site_path("toy", tmp_path / "data", download=True, source=address)
    assert path == tmp_path / "data" / "2d" / log.name
    assert path.read_bytes() == log.read_bytes()
    log.unlink()  # the second time nothing is fetched
    assert site_path("toy", tmp_path / "data", download=True, source=address) == path


def test_download_of_another_file_than_expected(toy, monkeypatch, tmp_path, address):
    monkeypatch.setitem(sites.CATALOGUE, "toy", replace(toy, sha256="0" * 64))
    with pytest.raises(InputError, match="site 'toy': download of .*toy-corrected.log.gz failed"):
        site_path("toy", tmp_path / "data", download=True, source=address)
    assert not [path for path in (tmp_path / "data").rglob("*") if path.is_file()]


def test_download_of_what_the_server_has_not(toy, monkeypatch, tmp_path, address):
    monkeypatch.setitem(sites.CATALOGUE, "toy", replace(toy, file="absent.log.gz"))
    with pytest.raises(InputError, match="download of .*absent.log.gz failed.*404"):
        site_path("toy", tmp_path / "data", download=True, source=address)


def test_where_logs_are_looked_for(monkeypatch, tmp_path):
    monkeypatch.setenv("HILBERTVAE_DATA", str(tmp_path / "chosen"))
    assert data_folder() == tmp_path / "chosen"
    monkeypatch.delenv("HILBERTVAE_DATA")
    here = tmp_path / "project"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert data_folder().name == "hilbertvae" and "shared" not in str(data_folder())
    (tmp_path / "shared" / "data").mkdir(parents=True)
    assert data_folder() == Path("../shared/data")


def test_the_catalogue_has_the_roles_of_the_protocol():
    roles = {dimension: {"train": set(), "validate": set(), "test": set()} for dimension in (2, 3)}
    for name, entry in CATALOGUE.items():
        roles[entry.dimension][entry.role].add(name)
        assert entry.name == name and len(entry.sha256) == 64
    assert roles[2] == {
        "train": {"fr079", "fr101", "aces", "belgioioso", "fhw", "mit-infinite-corridor"},
        "validate": {"csail"},
        "test": {"intel", "seattle", "orebro", "edmonton", "acapulco"},
    }
    assert (roles[3]["validate"], roles[3]["test"], len(roles[3]["train"])) == ({"kitti00_start"}, {"kitti_drive0005"}, 13)


def test_planar_lasers_have_the_beams_of_the_catalogue():
    for entry in CATALOGUE.values():
        if entry.dimension == 2:
            assert entry.step_deg == {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}[entry.beams]


def test_beams_of_3d_sites_start_where_the_catalogue_says():
    for entry in CATALOGUE.values():
        if entry.dimension == 3:
            start = find_beam_origins(entry.beam_origin)(np.array([[10.0, 0.0, 0.0], [10.0, 0.0, -4.0]]))
            expected = {"kitti": [0.20, 0.12], "nclt": [0.96, 0.96]}.get("kitti" if "kitti" in entry.name else entry.name[7:], [0.0, 0.0])
            assert start[:, 2].tolist() == expected, entry.name


def test_a_site_that_nobody_hands_out_is_not_downloaded(tmp_path):
    with pytest.raises(InputError, match="kitti00_start.*it can't be downloaded"):
        site_path("kitti00_start", tmp_path, download=True)


def test_sites_that_are_here_have_the_hashes_of_the_catalogue(real_sites):
    for name, path in real_sites.items():
        assert site_path(name, path.parents[1]) == path


def test_a_real_site_has_its_published_extent(real_sites):
    if "intel" not in real_sites:
        pytest.skip("intel is not here")
    scans = read_site("intel", real_sites["intel"].parents[1])
    assert scans.scan.max() + 1 == 910 and scans.beam.max() < 180
    extent = np.percentile(scans.points, 99.9, axis=0) - np.percentile(scans.points, 0.1, axis=0)
    np.testing.assert_allclose(extent, [29, 29], atol=2.0)
