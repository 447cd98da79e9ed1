"""A fitted map as one file, and back: safetensors, with all that is no array as JSON in its header. Nothing in it is ever executed."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError, check_positive, check_readable
from hilbertvae.files import atomic, copy_file, file_sha256
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.grids.frame import Frames
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.map_arrays import EVIDENCE, map_arrays
from hilbertvae.mappers.octomap_mapper import OCTREES, OctoMapMapper, read_octree
from hilbertvae.mappers.packed_array import pack, unpack
from hilbertvae.mappers.saved_evidence import evidence_of
from hilbertvae.mappers.turns import turn_of
from hilbertvae.mappers.weights import RankWeights
from hilbertvae.reconstruction.recorded_network import RecordedNetwork
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path

FORMAT = "hilbertvae-map-2"
PACKED = ("grids", "known")
"""Three quarters of the bytes in 3D, and more in 2D."""
SETTINGS = ("weights", "calibration", "neighbours", "inner_radius_m", "flips", "evidence", "fill", "ridge", "resolution_m", "seed")
"""Of the mapper's own; its network is known by a fingerprint, and a device belongs to a machine."""
MAP, ADAPTED = "map.safetensors", "adapted.safetensors"
"""In a folder that `hilbertvae-map` wrote: the map, and the network that learned from its site."""
LARGEST_SCALE = 4.0
"""Times the diameter of a cluster: no frame makes a larger box."""


def save_map(mapper: HilbertMap, path: str | os.PathLike) -> Path:
    """Write a fitted mapper as one file that `load_map` reads back, to the bit.

    It holds grids and evidence, and not the network, of which a fingerprint is enough for those that come with the package. One that
    learned from the site (`adapt_steps`) is not: `mapper.adapted_.save(path)` keeps it, for a map that is to grow later, and `load_map`
    finds it if it is `adapted.safetensors` beside the map; a loaded map's is copied along. What the cells of grids hold is packed. What
    scans have changed with `reconstruct=False` is reconstructed first, which may take minutes. Raises `InputError` for any other mapper,
    and for a name that ends as an OctoMap's does. Returns the path.
    """
    if Path(path).suffix.lower() in OCTREES:  # which `load_map` would take it for
        raise InputError(f"{path}: expected a name that does not end in {' or '.join(OCTREES)}, as OctoMap's files do")
    if not isinstance(mapper, HilbertMap):
        raise InputError(f"{path}: expected a HilbertMap to save, got {type(mapper).__name__}")
    with turn_of(mapper):
        return _saved(mapper, Path(path))


def _saved(mapper: HilbertMap, path: Path) -> Path:
    check_is_fitted(mapper)
    try:
        mapper.check_kept_settings()
        _rank_weights(mapper.rank_weights_.plain(), mapper)
    except InputError as error:
        raise InputError(f"{path}: a setting was changed after the map was made, so that it could not be read back; {error}") from error
    mapper.settle()
    network = mapper.adapted_ or mapper.completes_
    described = {
        "mapper": {
            **{name: getattr(mapper, name) for name in SETTINGS},
            "evidence": mapper.evidence_joins_,
            "fill": mapper.fills_,
            "grid": None if mapper.grid is None else asdict(mapper.grid),
        },
        "dimension": mapper.n_features_in_,
        "feature_names": None if (names := getattr(mapper, "feature_names_in_", None)) is None else list(names),
        "classes": mapper.classes_.tolist(),
        "grid": asdict(mapper.grid_),
        "resolution_m": mapper.evidence_.resolution_m,
        "flips": mapper.flips_,
        "rank_weights": mapper.rank_weights_.plain(),
        "network": None if network is None else network.fingerprint(),
    }
    metadata = {"format": FORMAT, "settings": json.dumps(described, sort_keys=True, default=lambda number: number.item())}
    arrays = {name: pack(array) if name in PACKED else np.ascontiguousarray(array) for name, array in map_arrays(mapper).items()}
    with atomic(path) as temporary:
        try:
            save_file(arrays, temporary, metadata=metadata)
        except SafetensorError as error:  # a full disk, for instance
            raise OSError(str(error)) from error  # which `atomic` names the file of
    if isinstance(network, RecordedNetwork) and (beside := network.kept_beside()):
        _carry(beside, path.parent / ADAPTED)
    return path


def _carry(beside: Path, there: Path) -> None:
    """Copy the network that learned from the site to where the map was saved, unless another map's is there, which would be lost."""
    if not there.exists():
        copy_file(beside, there)
    elif file_sha256(there) != file_sha256(beside):
        ways = f"to go on with the map, give its own: load_map(path, checkpoint={str(beside)!r})"
        warnings.warn(f"{there}: holds another network than the map's, and stays; {ways}", stacklevel=4)


def map_path(path: str | os.PathLike) -> Path:
    """The file of a map: of a folder, the `map.safetensors` in it."""
    return Path(path) / MAP if Path(path).is_dir() else Path(path)


def load_map(path: str | os.PathLike, checkpoint: str | os.PathLike | None = None, device: str = "cpu") -> HilbertMap | OctoMapMapper:
    """The fitted mapper that `save_map` wrote: it answers as the saved one did, to the bit, and needs no network for that. Of a
    folder, its `map.safetensors` is read. An OctoMap's `.ot` or `.bt` is read as the mapper that it is.

    checkpoint: the network that it was made with, for `partial_fit` and `fit`; unless given, it is looked for among those that come with
    the package and in `adapted.safetensors` beside the map, and only when it is needed. device: where that network computes, `cpu` or
    `cuda`. Raises `InputError` for a file that is missing, damaged or not ours.
    """
    path = map_path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a map, found no file")
    if checkpoint is not None and not checkpoint_path(checkpoint).is_file():  # now: it may first be needed much later
        raise InputError(f"checkpoint: expected a model.safetensors, or one of {', '.join(SHIPPED)}, got {checkpoint}, which is not there")
    if path.suffix.lower() in OCTREES:
        return read_octree(path)
    check_readable(path)
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            found = str(metadata.get("format"))
            if found != FORMAT:
                raise InputError(_another(found))
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
        described = json.loads(metadata["settings"])
        fingerprint = described["network"]
        network = None if fingerprint is None else RecordedNetwork(str(fingerprint), checkpoint, path.parent / ADAPTED)
        return _restored(described, arrays, network, device)
    except (SafetensorError, OSError) as error:
        wanted = "expected a file that save_map wrote, as map.safetensors of hilbertvae-map is"
        raise InputError(f"{path}: not a map of hilbertvae, or damaged ({error}); {wanted}{_instead(path)}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError) as error:
        raise InputError(f"{path}: the map's settings and arrays don't fit together ({error!r})") from error


def _instead(path: Path) -> str:
    """What to give for another file of a map: most are pictures and grids, which say nothing between and beyond their cells."""
    if path.name != MAP and (path.parent / MAP).is_file():
        return f"; the map in this folder is {path.parent / MAP}"
    return "; hilbertvae-map scans= makes one of a ROS map" if path.suffix.lower() in (".yaml", ".yml", ".pgm") else ""


def _another(found: str) -> str:
    if found.startswith("hilbertvae-map-"):
        return f"a map of another version ({found[:40]}), expected {FORMAT}"
    if found.startswith("hilbertvae-reconstructor-"):
        return "a network, which load_mapper reads; expected a map that save_map wrote"
    return f"a safetensors file, but not a map of hilbertvae (format {found[:40]!r}, expected {FORMAT!r})"


def _restored(described: dict, arrays: dict[str, np.ndarray], network: RecordedNetwork | None, device: str) -> HilbertMap:
    settings = dict(described["mapper"])
    own_grid = settings.pop("grid")
    if set(settings) != set(SETTINGS):
        raise InputError(f"settings: expected {', '.join(SETTINGS)}, got {', '.join(sorted(settings))[:200]}")
    mapper = HilbertMap(network, **settings, grid=None if own_grid is None else GridSettings.from_plain(own_grid), device=device)
    dimension = described["dimension"]
    if dimension not in (2, 3) or not isinstance(dimension, int):
        raise InputError(f"dimension: expected 2 or 3, got {str(dimension)[:40]}")
    mapper.evidence_joins_, mapper.fills_, mapper.completes_ = mapper.evidence, mapper.fill, network
    mapper.grid_, mapper.flips_ = GridSettings.from_plain(described["grid"]), described["flips"]
    mapper.check_kept_settings()
    evidence = {name.removeprefix(EVIDENCE): array for name, array in arrays.items() if name.startswith(EVIDENCE)}
    mapper.evidence_ = evidence_of(evidence, dimension, check_positive(described["resolution_m"], "resolution_m"))
    mapper.rank_weights_ = _rank_weights(described["rank_weights"], mapper)
    mapper.n_features_in_, mapper.classes_ = dimension, _classes(described["classes"])
    if (names := described.get("feature_names")) is not None:  # older maps don't say
        mapper.feature_names_in_ = _feature_names(names, dimension)
    _put_clusters(mapper, {name: array for name, array in arrays.items() if not name.startswith(EVIDENCE)})
    return mapper


def _put_clusters(mapper: HilbertMap, arrays: dict[str, np.ndarray]) -> None:
    """Check the arrays of clusters and their grids, and put them in their places."""
    count, dimension, grid = len(arrays["seeds"]), mapper.n_features_in_, mapper.grid_
    cells = (count, *(grid.cells,) * dimension)
    raw = mapper.reconstructor is None
    shapes = {
        "seeds": (np.float64, (count, dimension)),
        "small_seeds": (np.float64, (len(arrays.get("small_seeds", ())), dimension)),
        "centre": (np.float64, (count, dimension)),
        "scale": (np.float64, (count,)),
        "rotation": (np.float64, (count, dimension, dimension)),
        "grids": (np.int8 if raw else np.float16, cells),
        "known": (np.uint8, cells),
        "factors": (np.float64, (count,)),
    }
    if set(arrays) - set(shapes):
        raise InputError(f"expected arrays {', '.join(shapes)}, got {', '.join(sorted(set(arrays) - set(shapes)))[:200]}")
    arrays = {name: unpack(array, *shapes[name], name) if name in PACKED else array for name, array in arrays.items()}
    for name, array in arrays.items():
        kind, shape = shapes[name]
        if array.dtype != kind or array.shape != shape:
            raise InputError(f"{name}: expected {np.dtype(kind)} {shape}, got {array.dtype} {array.shape}")
        if not np.isfinite(array).all():
            raise InputError(f"{name}: expected finite numbers, got NaN or inf")
    if raw and not (np.abs(arrays["grids"]) <= 1).all():
        raise InputError("grids: expected -1, 0 and 1")
    low, high = mapper.evidence_.bounds()
    reach = grid.cluster_diameter_m * LARGEST_SCALE
    for name in ("seeds", "small_seeds", "centre"):
        if name in arrays and not ((arrays[name] >= low - reach) & (arrays[name] <= high + reach)).all():
            raise InputError(f"{name}: expected places in what was observed, {low.tolist()} to {high.tolist()} m")
    if not ((arrays["scale"] > 0) & (arrays["scale"] <= reach)).all():
        raise InputError(f"scale: expected at most {reach} m, and more than 0")
    turn = arrays.get("rotation", np.broadcast_to(np.eye(dimension), (count, dimension, dimension)))
    if not np.allclose(np.einsum("mde,mdf->mef", turn, turn), np.eye(dimension), atol=1e-6):
        raise InputError("rotation: expected rotations")
    mapper.frames_ = Frames(arrays["centre"], turn, arrays["scale"])
    mapper.seeds_, mapper.small_seeds_ = arrays["seeds"], arrays.get("small_seeds")
    mapper.grids_, mapper.known_, mapper.factors_ = arrays["grids"], arrays.get("known"), arrays.get("factors")


def _rank_weights(plain: dict, mapper: HilbertMap) -> RankWeights:
    features = mapper.evidence_.feature_count
    return RankWeights.from_plain(plain).checked(mapper.neighbours, features, "rank_weights")


def _feature_names(names: list, dimension: int) -> np.ndarray:
    """Those of a data frame's columns, which scikit-learn asks of later ones."""
    if not isinstance(names, list) or len(names) != dimension or not all(isinstance(name, str) for name in names):
        raise InputError(f"feature_names: expected {dimension} names, got {str(names)[:100]}")
    return np.array(names, dtype=object)


def _classes(values: list) -> np.ndarray:
    if not isinstance(values, list) or len(values) != 2 or len({type(value) for value in values}) != 1 or not values[0] < values[1]:
        raise InputError(f"classes: expected two labels in order, got {str(values)[:100]}")
    return np.array(values)
