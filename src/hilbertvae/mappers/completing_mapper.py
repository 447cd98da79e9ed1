"""The part of the Hilbert Map that asks its network, and lets it learn from the site."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.checks import InputError, check_cell_m, check_count, check_not_negative, check_positive, check_whole
from hilbertvae.cloud import READINGS, Cloud
from hilbertvae.gaps import NoRoom
from hilbertvae.grids.aligned_grid import IndexedCloud
from hilbertvae.grids.cluster_grids import PLACES, GridSettings, bin_shown, voxel_grid
from hilbertvae.grids.frame import Frames
from hilbertvae.grids.training_grids import gapped_grids
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.weights import check_calibration
from hilbertvae.reconstruction.completion import Completion
from hilbertvae.reconstruction.symmetry import check_flips
from hilbertvae.voxel_votes import inside_voxels, voxel_index

if TYPE_CHECKING:
    from hilbertvae.reconstruction.reconstructor import Reconstructor

CUT_GAPS_M = (1.5, 3.5)
"""Diameters of the gaps of each clustering that a network learns from, as in training."""
MOST_CLUSTERINGS = 8
SHOWN_BYTES = 2**28
"""Of what a network is shown of a map so much lies in memory at a time: with details it is larger than what is kept."""
BATCH, BATCH_CELLS = 64, 2**21
"""Grids that a network completes at a time, and their cells, if so many would have more: what its levels hold meanwhile grows with them."""


class CompletingMapper(Mapper):
    """Base of `GrowingMapper`. `completes_` is the network that the map's grids are of, whatever is set since, and `adapted_` what it
    became when it learned from the site, or None; a loaded map has none."""

    completes_: Reconstructor | None = None
    adapted_: Reconstructor | None = None
    progress: Callable[[int, int], None] | None = None
    """Called while grids are completed, with how many are done, and how many there are; no setting, since it changes nothing."""
    source: str = "points"
    """What warnings call that which a map is fitted to; no setting either."""

    def fits_like(self, other: Mapper) -> bool:
        """Whether the two differ in nothing but what their learned weights are calibrated for: their grids are the same."""
        if type(other) is not type(self) or self.weights == "cluster":  # whose factors are fitted around the calibrated ones
            return False
        mine, theirs = self.get_params(deep=False), other.get_params(deep=False)
        known = {mine.pop("calibration"), theirs.pop("calibration")} <= set(READINGS)
        return known and all(theirs[name] is value or theirs[name] == value for name, value in mine.items())

    def fit_as(self, other: CompletingMapper) -> CompletingMapper:
        """As every mapper's, but for the weights and how grids are read, which are this one's own."""
        super().fit_as(other)
        self.rank_weights_, self.grid_ = self._rank_weights(), self._own_grid(self.evidence_.resolution_m)
        return self

    def check_settings(self) -> None:
        super().check_settings()
        self.check_kept_settings()
        for name in ("evidence", "fill"):
            if not isinstance(value := getattr(self, name), (bool, np.bool_)):
                raise InputError(f"{name}: expected True or False, got {value!r}")
        if not (self.fill or self.evidence):
            raise InputError("evidence: expected True without fill, where nothing else answers")
        self._check_adaptation()

    def check_kept_settings(self) -> None:
        """An `InputError` that names one of those which a fitted map goes on asking, and its file keeps."""
        check_count(self.neighbours, "neighbours")
        for flips in (self.flips, getattr(self, "flips_", None)):  # as set, and as it is in a map's file
            check_flips(flips)
        if self.weights not in ("unit", "rank", "cluster"):
            raise InputError(f"weights: expected unit, rank or cluster, got {self.weights!r}")
        if self.grid is not None and not isinstance(self.grid, GridSettings):
            raise InputError(f"grid: expected GridSettings or None, got {self.grid!r}")
        if self.inner_radius_m is not None:
            check_positive(self.inner_radius_m, "inner_radius_m")
        if self.resolution_m is not None:
            check_cell_m(self.resolution_m, "resolution_m")
        check_calibration(self.calibration)
        check_not_negative(self.ridge, "ridge")
        if self.weights == "cluster":  # nothing else decides the weight of a cluster that no query touches
            check_positive(self.ridge, "ridge")

    def _check_network(self, dimension: int) -> None:
        """What may have been set since the map was begun, too."""
        if not (self.reconstructor is None or hasattr(self.reconstructor, "dimension")):  # a loaded map's is found when it is asked
            raise InputError(f"reconstructor: expected a Reconstructor or None, got {self.reconstructor!r}; load_mapper takes a name")
        if self.reconstructor is not None and self.reconstructor.dimension != dimension:
            raise InputError(f"points: the network is for {self.reconstructor.dimension}D, got {dimension}D points")
        from hilbertvae.reconstruction.precision import check_device  # late: a saved map answers without torch

        check_device(self.device)

    def _own_grid(self, resolution_m: float) -> GridSettings:
        """Of its boxes, checked; `interpolated` says how a map of this calibration is read."""
        grid = self.grid or (self.reconstructor.grid if self.reconstructor else voxel_grid(resolution_m))
        if self.inner_radius_m is not None:
            grid = replace(grid, inner_radius_m=self.inner_radius_m)
        grid.check()
        if self.reconstructor and grid.cells != self.reconstructor.grid.cells:
            self.reconstructor.check_cells(grid.cells)
        return replace(grid, interpolated=grid.read_between_cells(self.calibration))

    @property
    def detailed_(self) -> bool:
        return self.completes_ is not None and self.completes_.detailed  # more of each cell than its label

    def _warn_without_grids(self) -> None:
        """Of a site that has no place with enough returns."""
        few = f"at most {self.grid_.minimum_points} voxels with returns within {self.grid_.cluster_diameter_m / 2:g} m"
        left = "nothing is filled in: the map leaves what was not seen at 0.5"
        warnings.warn(f"{self.source}: found {few}, too few for a network, so that {left}", stacklevel=4)

    def _as_kept(self, cloud: Cloud) -> Cloud:
        """The cloud, or as the map keeps it, one point a voxel and label, where that is less: boxes that a later scan touches are made anew
        from that, and they alone would lose what is finer. No point lies on the side of a voxel, where a grid may take it for the next."""
        if self.evidence_.point_count() < len(cloud):
            return self.evidence_.cloud()
        resolution_m = self.evidence_.resolution_m
        points = inside_voxels(cloud.points, resolution_m, voxel_index(cloud.points, resolution_m))
        return Cloud(points, cloud.occupied, cloud.weight)

    def _as_sampled(self, cloud: Cloud) -> Cloud:
        """The cloud with its free samples counted as the network has learned it: a beam leaves one in each voxel that it passes, so that
        in voxels finer than the network's many of them fall into one cell of a grid, beside a single return, and outvote walls.

        Clouds of the network's own voxels, and of coarser ones, stay as they are, and so do those of raw grids.
        """
        if self.completes_ is None:
            return cloud
        share = self.evidence_.resolution_m / min(self.completes_.resolution_m, self.grid_.cell_m)
        if share > 1 - 1e-9:
            return cloud
        return Cloud(cloud.points, cloud.occupied, np.where(cloud.occupied, cloud.weight, share * cloud.weight))

    def _complete_boxes(self, cloud: Cloud, frames: Frames) -> Completion:
        """What the network makes of the cloud in the boxes of `frames`."""
        whole, found_in = None, IndexedCloud.around(self._as_sampled(cloud), frames) if len(frames) else cloud
        for part, found in self._completed_parts(lambda boxes: found_in, frames):
            if len(found.value) == len(frames):
                return found
            if whole is None:  # parts that are joined in the end would lie in memory twice
                rows = (found.value, found.known)
                whole = Completion(*(kind if kind is None else np.empty((len(frames), *kind.shape[1:]), kind.dtype) for kind in rows))
            whole.value[part] = found.value
            if whole.known is not None:
                whole.known[part] = found.known
        return whole or self._complete(bin_shown(cloud, frames, self.grid_, self.detailed_))  # of no frames

    def _completed_parts(self, cloud_in: Callable[[Frames], Cloud | IndexedCloud], frames: Frames) -> Iterator[tuple[slice, Completion]]:
        """(part, what the network makes of it) for one part of the frames after the other, whole batches each; `cloud_in` gives the
        points around some frames, counted as `_as_sampled` does."""
        count, dimension = frames.centre.shape
        channels = PLACES + dimension if self.detailed_ else 1
        cells, batch = self.grid_.cells**dimension, self._batch(dimension)
        at_once = max(1, SHOWN_BYTES // (channels * cells * batch)) * batch
        for start in range(0, count, at_once):
            chosen = slice(start, min(start + at_once, count))
            boxes = frames.select(chosen)
            report = self.progress and (lambda done, _, start=start: self.progress(start + done, count))
            yield chosen, self._complete(bin_shown(cloud_in(boxes), boxes, self.grid_, self.detailed_), report)

    def _complete(self, grids: np.ndarray, progress: Callable[[int, int], None] | None = None) -> Completion:
        network = self.adapted_ or self.completes_
        if network is None:
            return Completion(grids, None)
        batch = self._batch(network.dimension)
        return network.complete(grids, self.flips_, batch=batch, device=self.device, progress=progress)

    def _batch(self, dimension: int) -> int:
        return max(1, min(BATCH, BATCH_CELLS // self.grid_.cells**dimension))

    def _check_adaptation(self) -> None:
        steps = check_whole(self.adapt_steps, "adapt_steps")
        if steps and self.reconstructor is None:
            raise InputError("adapt_steps: expected a network that can learn, got raw grids")
        if steps and not self.fill:
            raise InputError("adapt_steps: expected 0 without fill, where no network is asked")
        if steps and self.weights == "cluster":  # what is hidden for the factors would be asked of a network that has learned from it
            raise InputError("adapt_steps: expected 0 with weights=cluster, whose factors are learned on the same points")

    def _adapt(self, cloud: Cloud) -> Reconstructor:
        """The network after `adapt_steps` on gaps that are cut from the cloud for this alone: several clusterings, until each grid is seen
        about once or there are enough. Of a site too small for gaps it learns nothing, with a warning."""
        from hilbertvae.reconstruction.adaptation import adapted, batch_size
        from hilbertvae.reconstruction.reconstructor import Reconstructor

        network = self.reconstructor if isinstance(self.reconstructor, Reconstructor) else self.reconstructor.found  # a loaded map's
        shown, target, cloud = [], [], self._as_sampled(cloud)
        wanted = self.adapt_steps * batch_size(self.grid_, network.dimension)
        for number in range(MOST_CLUSTERINGS):
            seed = int(self.seed) + 1000 * (number + 1)  # others than those of the map's own clusters
            try:
                pair = gapped_grids(cloud, self.evidence_.resolution_m, self.grid_, CUT_GAPS_M, seed, network.detailed, wanted)
            except NoRoom:
                continue
            shown.append(pair[0])
            target.append(pair[1])
            wanted -= len(pair[0])
            if wanted <= 0:
                break
        if not sum(map(len, shown)):
            warnings.warn("adapt_steps: the site is too small to cut gaps from, and its network stays as it is", stacklevel=4)
            return network
        pairs = np.concatenate(shown), np.concatenate(target)
        return adapted(network, *pairs, self.grid_, self.adapt_steps, self.seed, self.device)
