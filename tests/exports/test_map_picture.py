import numpy as np
import pytest
from PIL import Image

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.map_picture import write_picture


def cells_of(index, observed=True, probability=0.9):
    count = len(index)
    return MapCells(np.array(index), 0.2, np.full(count, probability), np.zeros(count), np.full(count, observed))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [1, 2, 500])
def test_any_number_of_cells_makes_a_picture(dimension, count, tmp_path):
    index = np.unique(np.random.default_rng(0).integers(0, 30, (count, dimension)), axis=0) - 10_000_000
    image = np.asarray(Image.open(write_picture(cells_of(index), tmp_path / "map.png", "a map")))
    assert image.shape[0] > 100 and image.std() > 5


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_was_filled_in_is_in_the_second_panel_alone(dimension, tmp_path):
    index = np.stack(np.meshgrid(*[np.arange(12)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    observed = index[:, 0] < 6
    cells = MapCells(index, 0.2, np.full(len(index), 0.95), np.zeros(len(index)), observed)
    image = np.asarray(Image.open(write_picture(cells, tmp_path / "map.png", "")).convert("L")).astype(int)
    halves = np.array_split(image, 2, axis=1 if dimension == 2 else 0)
    dark = [np.count_nonzero((half > 20) & (half < 200)) if dimension == 3 else np.count_nonzero(half < 60) for half in halves]
    assert dark[1] > 1.2 * dark[0] > 0


@pytest.mark.parametrize("shape", [(30, 25), (60, 25), (25, 25, 4)])
def test_a_map_of_which_nothing_was_filled_in_is_shown_once(shape, tmp_path):
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, len(shape))
    sizes = [
        Image.open(write_picture(cells_of(index, observed=observed), tmp_path / "map.png", "a map")).size for observed in (False, True)
    ]
    (width, height), (once, low) = sizes
    assert (once, low) != (width, height) and (once < 0.65 * width or low < 0.65 * height)


def test_what_was_observed_stays_beside_a_predicted_wall_where_a_pixel_is_several_cells(tmp_path, monkeypatch):
    monkeypatch.setattr("hilbertvae.exports.map_picture.MOST_PX", 20)
    index = np.stack(np.meshgrid(*[np.arange(40)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    observed = index[:, 0] % 2 == 0
    cells = MapCells(index, 0.2, np.where(observed, 0.0, 1.0), np.zeros(len(index)), observed)
    image = np.asarray(Image.open(write_picture(cells, tmp_path / "map.png", "")).convert("L")).astype(int)
    sheets = np.array_split(image[:, : int(image.shape[1] * 0.9)], 2, axis=1)  # without the colour bar
    left, right = (sheet[sheet.shape[0] // 2, sheet.shape[1] // 2] for sheet in sheets)
    assert left > 240 and right < 60  # free as it was seen, and the wall that hides it in the other panel


@pytest.mark.parametrize("shape", [(2, 400), (400, 2)])
def test_a_corridor_has_room_for_its_titles(shape, tmp_path, recwarn):
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    image = Image.open(write_picture(cells_of(index), tmp_path / "map.png", "corridor"))
    assert min(image.size) > 200 and not recwarn.list


@pytest.mark.parametrize("shape", [(60, 30), (59, 30)])
def test_a_flat_map_takes_the_room_of_its_picture(shape, tmp_path):
    """Two sheets one above the other are as wide as the picture; beside each other they have half of it each."""
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    image = np.asarray(Image.open(write_picture(cells_of(index), tmp_path / "map.png", "")).convert("L"))
    inked = np.count_nonzero((image < 250).any(axis=0))
    assert inked > 0.8 * image.shape[1]


def test_free_space_alone_is_no_fault(tmp_path):
    index = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    assert write_picture(cells_of(index, probability=0.1), tmp_path / "map.png", "free").exists()


def test_no_cells(tmp_path):
    with pytest.raises(InputError, match="map.png: expected a map with known cells"):
        write_picture(cells_of(np.zeros((0, 2), int)), tmp_path / "map.png", "none")
    assert not list(tmp_path.iterdir())
