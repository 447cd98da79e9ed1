"""OctoMap (Hornung et al. 2013), the baseline: log-odds per voxel, clamped, and nothing said of what was not seen (METHOD 6).

It is fed labelled points, not rays, which would carve the gaps. In 2D the map is one layer of voxels, that of 0 <= z < resolution.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import octomap
from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError, check_cell_m, check_positive
from hilbertvae.cloud import RESOLUTION_M
from hilbertvae.files import atomic
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.octree import NONE, SIDE, leaves_of_labels, leaves_of_values, morton, stream_of
from hilbertvae.observed_map import warn_of_filled
from hilbertvae.voxel_votes import voxel_floor

ORIGIN = SIDE // 2
"""The key of the voxel whose lower corner is the map's origin."""
_TITLES = {".ot": "# Octomap OcTree file", ".bt": "# Octomap OcTree binary file"}
OCTREES = tuple(_TITLES)
"""How the names of OctoMap's files end."""
_SHIFT = "# hilbertvae shift_voxels "
"""Begins the comment line of our files that says what their formats have no place for: `shift_`, one number per axis of the map."""
_CELLS = "# hilbertvae cells "
"""Begins the line that says which cells a file of ours has: `all`, also those that were predicted, or `observed`."""
_LONGEST_HEADER = 1 << 16


class OctoMapMapper(Mapper):
    """p(occupied) of the voxel that holds a query, 0.5 where no point was seen.

    A voxel's log-odds start at 0; each sample adds logit(prob_miss) or logit(prob_hit), and every sum is clamped to the logits of
    clamp_min and clamp_max. A point of weight n votes n times. Since sums are clamped, order counts: each voxel gets all its frees, then
    all its hits, as OctoMap's `insertPointCloud` does with one scan. So the many beams that graze a wall do not erase it: on csail's
    held-out beams F1 is 0.95 on points and 0.92 on voxels, 0.68 on both with hits first, 0.91 and 0.88 with one sum clamped at its end.

    resolution_m: 0.1 in 2D and 0.2 in 3D unless given. Voxels are those of `voxel_votes.voxel_index`. An extent of more than 65 536 of them
    gives `InputError`; where the cloud lies does not matter, since keys of a far one (UTM) are shifted by whole voxels (`shift_`).
    """

    def __init__(self, resolution_m=None, prob_hit=0.7, prob_miss=0.4, clamp_min=0.1192, clamp_max=0.971):
        self.resolution_m = resolution_m
        self.prob_hit = prob_hit
        self.prob_miss = prob_miss
        self.clamp_min = clamp_min
        self.clamp_max = clamp_max

    def check_settings(self) -> None:
        super().check_settings()
        if self.resolution_m is not None:
            check_positive(self.resolution_m, "resolution_m")
        limits = {"prob_hit": (0.5, 1), "prob_miss": (0, 0.5), "clamp_min": (0, 0.5), "clamp_max": (0.5, 1)}
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low < check_positive(value, name) < high:
                raise InputError(f"{name}: expected a probability between {low} and {high}, got {value!r}")

    def _fit(self, points, occupied, weight):
        dimension = points.shape[1]
        if dimension not in RESOLUTION_M:
            raise InputError(f"points: expected shape (N, 2) or (N, 3), got {points.shape}")
        self.resolution_ = RESOLUTION_M[dimension] if self.resolution_m is None else float(self.resolution_m)
        tree = self._with_settings(octomap.OcTree(self.resolution_))
        self.shift_ = voxel_shift(points, self.resolution_)
        keys = self._keys(points)
        for hit, step in ((False, _log_odds(self.prob_miss)), (True, _log_odds(self.prob_hit))):
            self._vote(tree, keys[occupied == hit], weight[occupied == hit] * step)
        self.leaves_ = leaves_of_values(_split(tree.write())[1])[0]

    def _vote(self, tree: octomap.OcTree, keys: np.ndarray, votes: np.ndarray) -> None:
        """Add `votes (N,)`, log-odds of one sign, to the voxels `keys (N, 3)`."""
        _, first, voxel = np.unique(morton(keys), return_index=True, return_inverse=True)
        # Sums far beyond both clamps are alike, and float32 takes no greater ones.
        most = 2 * (_log_odds(self.clamp_max) - _log_odds(self.clamp_min))
        total = np.clip(np.bincount(voxel, weights=votes), -most, most)
        # Centres, and not the points: OctoMap rounds to float32, which would carry some across a voxel's side.
        centres = (keys[first] - ORIGIN + 0.5) * self.resolution_
        # In Morton order, in which neighbours share their branch: more than twice as fast as in any other.
        for centre, vote in zip(centres, total.tolist(), strict=True):
            tree.updateNode(centre, vote)

    def _probability(self, queries):
        leaf = self._find(queries)
        seen = leaf != NONE
        probability = np.full(len(queries), 0.5)
        probability[seen] = 1.0 - 1.0 / (1.0 + np.exp(self.leaves_.log_odds[leaf[seen]].astype(np.float64)))
        return probability

    def observed(self, queries) -> np.ndarray:
        """(Q,) bool: whether the voxel of each query was observed."""
        check_is_fitted(self)
        return self._find(self._checked(queries)) != NONE

    def stored_bytes(self) -> int:
        """As an `.ot` file."""
        check_is_fitted(self)
        return len(_ot_bytes(self))

    def tree(self) -> octomap.OcTree:
        """The map as an OctoMap tree of its own, with these settings. Its origin is voxel `shift_` of the map's lattice."""
        check_is_fitted(self)
        return self._with_settings(octomap.OcTree.read(_ot_bytes(self)))

    def _find(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) the leaf that holds each of `queries (Q, D)`, -1 where there is none."""
        with np.errstate(over="ignore"):
            keys = self._keys(queries)
        inside = ((keys >= 0) & (keys < SIDE)).all(axis=1)
        found = np.full(len(queries), NONE)
        found[inside] = self.leaves_.find(morton(keys[inside]))
        return found

    def _keys(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) float64: the key of each point's voxel, whole numbers, outside of 0 to 65 535 where the tree ends."""
        keys = np.full((len(points), 3), float(ORIGIN))
        for axis, (place, shift) in enumerate(zip(points.T, self.shift_, strict=True)):
            keys[:, axis] += voxel_floor(place / self.resolution_) - shift
        return keys

    def _with_settings(self, tree: octomap.OcTree) -> octomap.OcTree:
        self.check_settings()
        tree.setProbHit(self.prob_hit)
        tree.setProbMiss(self.prob_miss)
        tree.setClampingThresMin(self.clamp_min)
        tree.setClampingThresMax(self.clamp_max)
        return tree


def voxel_shift(points: np.ndarray, resolution_m: float) -> np.ndarray:
    """(D,) whole numbers in float64: the voxel that gets key 32 768 on each axis, 0 wherever `points (N, D)` allow it."""
    low_m, high_m = points.min(axis=0), points.max(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        low, high = voxel_floor(low_m / resolution_m), voxel_floor(high_m / resolution_m)
        fits = (high - low < SIDE).all()
    if not fits:
        span = f"{low_m.tolist()} to {high_m.tolist()} m"
        raise InputError(f"points: expected at most {SIDE} voxels of {resolution_m} m per axis, got {span}; is there an outlier?")
    return np.where((low < -ORIGIN) | (high >= ORIGIN), np.ceil(low / 2 + high / 2), 0.0)


def write_octree(mapper: OctoMapMapper, path: str | os.PathLike, cells: str = "observed") -> None:
    """Write a fitted mapper as `path`, which OctoMap's tools read: `.ot` keeps its probabilities, `.bt` only free and occupied.

    Comment lines in the header keep `shift_`, which also tells a map of two axes, and which `cells` there are: `observed`, or `all` if some
    were predicted. Raises `InputError` for another ending, and for a
    `.bt` of one leaf all over the tree, which that format has no word for.
    """
    path = Path(path)
    check_is_fitted(mapper)
    if path.suffix not in _TITLES:
        raise InputError(f"{path}: expected a name that ends in .ot or .bt")
    if path.suffix == ".ot":
        content = _ot_bytes(mapper, cells)
    else:
        tree = mapper.tree()
        stream = _split(tree.writeBinary())[1]
        if tree.size() == 1:
            raise InputError(f"{path}: expected a tree of more than one leaf, got one label everywhere")
        content = _header(mapper, ".bt", tree.size(), cells) + stream
    with atomic(path) as temporary:
        temporary.write_bytes(content)


def read_octree(path: str | os.PathLike) -> OctoMapMapper:
    """The fitted mapper of an OctoMap file: `.ot`, or `.bt`, whose leaves get p = 0.1192 (free) and 0.971 (occupied).

    A file that we did not write is a map of three axes. Raises `InputError` for one that is missing, damaged, or of another kind; a
    `UserWarning` says that cells were predicted, which all count as observed here.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected an OctoMap file, found none")
    try:
        content = path.read_bytes()
        mapper = _mapper_of(content)
    except (InputError, OSError) as error:
        raise InputError(f"{path}: {error}") from error
    if f"{_CELLS}all" in _split(content)[0]:
        warn_of_filled(path)
    return mapper


def _mapper_of(content: bytes) -> OctoMapMapper:
    head, stream = _split(content)
    titles = [ending for ending, title in _TITLES.items() if head[0].rstrip() == title]
    fields = dict(line.partition(" ")[::2] for line in head[1:] if not line.startswith("#"))
    if not titles or fields.get("id") != "OcTree":
        kind = str(fields.get("id"))[:40]
        raise InputError(f"expected a first line {list(_TITLES.values())} and id OcTree, got {head[0][:40]!r} and id {kind}")
    mapper = OctoMapMapper(resolution_m=check_cell_m(_number(fields.get("res")), "res"))
    shifts = [line.removeprefix(_SHIFT).split() for line in head if line.startswith(_SHIFT)] or [["0"] * 3]
    shift = np.array([_number(word) for word in shifts[0]])
    if len(shift) not in RESOLUTION_M or not (np.isfinite(shift) & (shift == np.rint(shift))).all():
        raise InputError(f"{_SHIFT[2:-1]}: expected 2 or 3 whole numbers, got {shift[:4].tolist()}")
    if titles == [".ot"]:
        leaves, count = leaves_of_values(stream)
    else:
        leaves, count = leaves_of_labels(stream, _log_odds(mapper.clamp_min), _log_odds(mapper.clamp_max))
    if fields.get("size") != str(count):
        raise InputError(f"size: expected {str(fields.get('size'))[:40]} nodes, found {count}")
    mapper.classes_, mapper.n_features_in_ = np.array([False, True]), len(shift)
    mapper.resolution_, mapper.shift_, mapper.leaves_ = mapper.resolution_m, shift, leaves
    return mapper


def _ot_bytes(mapper: OctoMapMapper, cells: str = "observed") -> bytes:
    stream, count = stream_of(mapper.leaves_)
    return _header(mapper, ".ot", count, cells) + stream


def _header(mapper: OctoMapMapper, ending: str, count: int, cells: str) -> bytes:
    # repr, since OctoMap's own six digits of the resolution would move the far end of a map.
    shift = " ".join(f"{value:.0f}" for value in mapper.shift_)
    head = [_TITLES[ending], _SHIFT + shift, _CELLS + cells, "id OcTree", f"size {count}", f"res {float(mapper.resolution_)!r}", "data"]
    return "\n".join([*head, ""]).encode()


def _split(content: bytes) -> tuple[list[str], bytes]:
    """The lines of a file's header, and the nodes behind it."""
    end = content.find(b"\ndata\n", 0, _LONGEST_HEADER)
    if end < 0:
        raise InputError("expected an OctoMap header that ends in a line 'data', got none")
    return content[:end].decode("latin-1").split("\n"), content[end + 6 :]


def _number(word: str | None) -> float:
    try:
        return float(word)
    except (TypeError, ValueError):
        raise InputError(f"expected a number, got {str(word)[:40]!r}") from None


def _log_odds(probability: float) -> float:
    """As OctoMap has it, in float32."""
    return float(np.float32(np.log(probability / (1 - probability))))
