import base64
import io
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from hilbertvae.checks import InputError
from hilbertvae.drawing.lit_colours import GAP_TINT, LIT_TINT, UNCERTAINTY_TINT
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.page import write_page

TABLES = {"Cells": [["", "before"], ["occupied <b>", "12"]]}


def some_cells(dimension, count=400, seed=0):
    """A block of known cells far from the origin, some occupied, some predicted."""
    rng = np.random.default_rng(seed)
    index = np.unique(rng.integers(-12, 12, (count, dimension)), axis=0) + np.array([50_000, -70_000, 30])[:dimension]
    n = len(index)
    return MapCells(index, 0.1, rng.random(n).astype(np.float32), (rng.random(n) / 2).astype(np.float32), rng.random(n) < 0.5)


def data_of(path):
    return json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', path.read_text(), re.S)[1])


def pixels(url):
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.removeprefix("data:image/png;base64,")))))


def test_pictures_of_a_flat_map_show_each_cell_in_its_place(tmp_path):
    cells = some_cells(2)
    found = data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))
    observed, filled = (pixels(found["modes"][0][name]) for name in ("observed", "filled"))
    low, high = cells.index.min(axis=0), cells.index.max(axis=0)
    assert observed.shape[:2] == filled.shape[:2] == tuple((high - low + 1)[::-1])
    shown = np.zeros(observed.shape[:2], bool)
    for (x, y), seen, p in zip(cells.index, cells.observed, cells.probability, strict=True):
        row, column = high[1] - y, x - low[0]  # the picture's first row is the map's last
        shown[row, column] = True
        assert (observed[row, column, 3] == 255) == seen and (filled[row, column, 3] == 255) == (not seen)
        colour = (observed if seen else filled)[row, column]
        assert (colour[0] < colour[2]) == (p < 0.4) or 0.3 < p < 0.6  # bluish where free
    assert (observed[~shown, 3] == 0).all() and (filled[~shown, 3] == 0).all()


def test_what_was_observed_stays_beside_a_predicted_wall_where_a_pixel_is_several_cells(tmp_path, monkeypatch):
    monkeypatch.setattr("hilbertvae.exports.page.MOST_PIXELS", 20)
    index = np.stack(np.meshgrid(*[np.arange(40)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    seen = index[:, 0] % 2 == 0
    cells = MapCells(index, 0.2, np.where(seen, 0.0, 1.0), np.full(len(index), 0.1), seen)
    for mode in data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))["modes"]:
        assert (pixels(mode["observed"])[..., 3] == 255).all() and (pixels(mode["filled"])[..., 3] == 255).all()
        if mode["name"] == "probability":
            assert (pixels(mode["observed"])[..., 0] > 200).all() and (pixels(mode["filled"])[..., :3] < 60).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_page_knows_whether_anything_was_filled_in(dimension, tmp_path):
    """Else it would have a second half, and switches, that show nothing."""
    cells = some_cells(dimension)
    assert data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))["filled"] is True
    assert data_of(write_page(cells.select(cells.observed), tmp_path / "map.html", "a map", TABLES))["filled"] is False


def test_voxels_of_a_solid_map_come_back(tmp_path):
    cells = some_cells(3, 3000)
    found = data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))
    occupied = cells.select(cells.occupied)
    place = np.frombuffer(base64.b64decode(found["cells"]), "<u2").reshape(-1, 3)
    value = np.frombuffer(base64.b64decode(found["values"]), np.uint8).reshape(-1, 4)
    np.testing.assert_array_equal(place + occupied.index.min(axis=0), occupied.index)
    np.testing.assert_array_equal(value[:, 3] == 255, occupied.observed)
    np.testing.assert_allclose(value[:, 1] / 255, (occupied.probability - 0.6) / 0.4, atol=0.003)
    np.testing.assert_allclose(value[:, 2] / 255, np.clip(occupied.std / 0.5, 0, 1), atol=0.003)
    tints = {mode["name"]: to_hex(mode["tint"]) for mode in found["modes"]}
    assert tints == {"height": GAP_TINT, "probability": LIT_TINT, "uncertainty": UNCERTAINTY_TINT}


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("std", [0.0, np.nan])
def test_where_nobody_was_asked_how_sure_it_is_the_page_does_not_say(dimension, std, tmp_path):
    cells = some_cells(dimension)
    asked = [mode["name"] for mode in data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))["modes"]]
    cells.std[:] = std
    assert asked[-1] == "uncertainty"
    assert [mode["name"] for mode in data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))["modes"]] == asked[:-1]


def test_a_solid_map_without_anything_occupied_says_so(tmp_path):
    cells = some_cells(3)
    assert "nothing is occupied" not in write_page(cells, tmp_path / "map.html", "a map", TABLES).read_text()
    cells.probability[:] = 0.3
    assert "nothing is occupied" in write_page(cells, tmp_path / "map.html", "a map", TABLES).read_text()


def test_a_page_in_coarser_cells_says_so(tmp_path, monkeypatch):
    assert "shown in cells of" not in write_page(some_cells(2), tmp_path / "map.html", "a map", TABLES).read_text()
    monkeypatch.setattr("hilbertvae.exports.page.MOST_PIXELS", 12)
    assert "shown in cells of 0.2 m" in write_page(some_cells(2), tmp_path / "map.html", "a map", TABLES).read_text()


@pytest.mark.parametrize("dimension", [2, 3])
def test_nothing_is_fetched_and_nothing_is_markup_that_should_not_be(dimension, tmp_path):
    text = write_page(some_cells(dimension), tmp_path / "map.html", "</script><b>drive", TABLES).read_text()
    assert not re.search(r"""(src|href)\s*=\s*["']|https?://|@import|url\(""", text)
    assert "&lt;/script&gt;&lt;b&gt;drive" in text and "occupied &lt;b&gt;" in text
    assert text.count("</script>") == 2


def test_too_many_voxels_are_joined_and_none_is_lost(tmp_path, monkeypatch):
    monkeypatch.setattr("hilbertvae.exports.page.MOST_CELLS", 300)
    cells = some_cells(3, 3000)
    found = data_of(write_page(cells, tmp_path / "map.html", "a map", TABLES))
    factor = round(found["resolution_m"] / 0.1)
    place = np.frombuffer(base64.b64decode(found["cells"]), "<u2").reshape(-1, 3)
    assert factor in (2, 4, 8) and len(place) <= 300
    assert len(place) == len(np.unique(cells.index[cells.occupied] // factor, axis=0))


def test_an_empty_map_is_refused(tmp_path):
    with pytest.raises(InputError, match="map.html: expected a map with known cells"):
        write_page(some_cells(2).select(np.zeros(0, int)), tmp_path / "map.html", "a map", TABLES)
    assert not list(tmp_path.iterdir())


def browser():
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def shown_by_browser(page, folder, act=""):
    """The DOM after loading, and the brightness (H, W) of the map's part of the window; act: JavaScript, run once the page is ready."""
    if act:
        then = f"if (!document.querySelector('[data-ready]')) return; clearInterval(wait); {act}"
        page.write_text(page.read_text() + f"<script>const wait = setInterval(() => {{ {then} }}, 20);</script>")
    options = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=900,900"]
    options += ["--virtual-time-budget=8000", f"--user-data-dir={folder / 'profile'}"]
    shot = folder / "shot.png"
    told = ""
    for _ in range(3):  # on a busy machine the browser's own clock may run out before it has drawn
        for what in (f"--screenshot={shot}", "--dump-dom"):
            told = subprocess.run([browser(), *options, what, page.as_uri()], capture_output=True, timeout=120, check=True).stdout.decode()
        if "data-ready" in told:
            break
    return told, np.asarray(Image.open(shot).convert("RGB")).astype(int)[60:640]


def sheet(dimension):
    """A square of occupied cells, a seventh of which was observed."""
    side = np.stack(np.meshgrid(*[np.arange(24)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    index = side if dimension == 2 else np.column_stack([side, np.zeros(len(side), int)])
    dark = np.full(len(index), 0.99, np.float32)
    return MapCells(index, 0.1, dark, np.linspace(0, 0.5, len(index), dtype=np.float32), np.arange(len(index)) % 7 == 0)


def drawn(image, dimension):
    """How many pixels of the left and of the right half show a cell: the ground's colour is light, the background is 236."""
    dark = image @ [0.299, 0.587, 0.114] < (120 if dimension == 2 else 215)
    return np.count_nonzero(dark[:, :440]), np.count_nonzero(dark[:, 460:])


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_browser_draws_it(dimension, tmp_path):
    """Before on the left, after on the right: the right half has more of the map, and the page reports no fault."""
    page = write_page(sheet(dimension), tmp_path / "map.html", "a map", TABLES)
    told, image = shown_by_browser(page, tmp_path)
    assert f'data-ready="{dimension}"' in told and '<p id="fault"></p>' in told
    left, right = drawn(image, dimension)
    assert right > 1.5 * left > 0  # seen from the side, cells hide gaps between them


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
@pytest.mark.parametrize("dimension", [2, 3])
def test_what_a_reader_can_do_on_it(dimension, tmp_path):
    """The slider, the layers, the colours, and in 3D turning."""

    def after(name, act):
        return shown_by_browser(write_page(sheet(dimension), tmp_path / f"{name}.html", "a map", TABLES), tmp_path, act)[1]

    before = after("before", "")
    left, right = drawn(before, dimension)
    slid = after("slid", "const s = document.getElementById('split'); s.value = 0; s.oninput();")
    assert drawn(slid, dimension)[0] > 1.5 * left and drawn(slid, dimension)[1] == right
    seen = after("seen", "const f = document.getElementById('filled'); f.checked = false; f.oninput();")
    assert drawn(seen, dimension)[1] < right / 1.5 and drawn(seen, dimension)[0] == left
    modes = [mode["name"] for mode in data_of(tmp_path / "before.html")["modes"]]
    other = after("other", f"const m = document.getElementById('mode-' + {modes[-1]!r}); m.checked = true; m.onchange();")
    assert (other != before).any(axis=2).mean() > 0.05
    closer = after("closer", "for (let n = 0; n < 3; n++) document.getElementById('closer').click();")
    assert (closer != before).any(axis=2).mean() > 0.05
    there_and_back = "for (const id of ['farther', 'closer', 'closer', 'whole']) document.getElementById(id).click();"
    np.testing.assert_array_equal(after("whole", there_and_back), before)
    if dimension == 3:
        turned = after("turned", "window.turn(0.7, 0.5);")
        assert (turned != before).any(axis=2).mean() > 0.05


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
@pytest.mark.parametrize("long", [0, 1, None])
def test_a_solid_map_is_seen_whole_and_as_large_as_it_can_be(long, tmp_path):
    """A street that lies along x or y, or a field as wide as long: nothing of it beside the view, and the view no wider than it."""
    index = np.stack(np.meshgrid(*[np.arange(300 if long in (axis, None) else 30) for axis in range(2)], [0], indexing="ij"), axis=-1)
    dark, index = np.ones(index[..., 0].size, np.float32), index.reshape(-1, 3)
    page = write_page(MapCells(index, 0.1, dark, 0 * dark, dark > 0), tmp_path / "map.html", "a map", TABLES)
    hidden = "for (const id of ['split', 'line']) document.getElementById(id).style.visibility = 'hidden';"  # what draws asks the slider
    _, image = shown_by_browser(page, tmp_path, hidden)
    ground = np.ptp(image, axis=2) > 8
    ground[:40] = ground[-40:] = False  # what the page writes into its corners
    columns, rows = np.flatnonzero(ground.any(axis=0)), np.flatnonzero(ground.any(axis=1))
    assert 20 + 5 < columns[0] < 70 and 900 - 70 < columns[-1] < 900 - 20 - 5
    assert rows[-1] < 540


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
def test_the_place_under_the_pointer_is_told(tmp_path):
    page = write_page(some_cells(2), tmp_path / "map.html", "a map", TABLES)
    low, high = np.array([50_000, -70_000]) - 12, np.array([50_000, -70_000]) + 12  # of 400 cells some lie along each side
    middle = "{clientX: s.offsetLeft + s.clientWidth / 2, clientY: s.offsetTop + s.clientHeight / 2}"
    act = f"const v = document.getElementById('view'), s = v.parentElement; v.dispatchEvent(new PointerEvent('pointermove', {middle}));"
    told, _ = shown_by_browser(page, tmp_path, act)
    place = [float(number) for number in re.search(r'id="place">([-\d.]+), ([-\d.]+) m<', told).groups()]
    np.testing.assert_allclose(place, (low + high) / 2 * 0.1, atol=0.06)


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
def test_a_browser_that_draws_no_solid_things_says_so(tmp_path):
    page = write_page(sheet(3), tmp_path / "map.html", "a map", TABLES)
    page.write_text(page.read_text().replace('"use strict";', "HTMLCanvasElement.prototype.getContext = () => null;", 1))
    told, _ = shown_by_browser(page, tmp_path)
    assert "The map can't be shown: this browser draws no WebGL" in told and "data-ready" not in told.split("<script")[0]


@pytest.mark.skipif(browser() is None, reason="no Chromium here")
@pytest.mark.parametrize("dimension", [2, 3])
def test_two_fingers_come_closer_by_as_much_as_they_move_apart(dimension, tmp_path):
    act = """
      const view = document.getElementById('view'), bar = document.getElementById('scale'); view.setPointerCapture = () => {};
      const finger = (kind, id, x) => view.dispatchEvent(new PointerEvent(kind, { pointerId: id, clientX: x, clientY: 300, buttons: 1 }));
      const pixelsPerMetre = () => parseFloat(bar.style.width) / parseFloat(bar.textContent), before = pixelsPerMetre();
      finger('pointerdown', 1, 300); finger('pointerdown', 2, 500); finger('pointermove', 2, 600);
      document.title = pixelsPerMetre() / before;"""
    told, _ = shown_by_browser(write_page(sheet(dimension), tmp_path / "map.html", "a map", TABLES), tmp_path, act)
    assert float(re.search("<title>(.*?)</title>", told)[1]) == pytest.approx(1.5, abs=0.01)
