"""The network that a saved map was made with: looked for when it is first needed, since answers need none."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.reconstruction.completion import Completion
from hilbertvae.reconstruction.shipped import SHIPPED

if TYPE_CHECKING:
    from hilbertvae.reconstruction.reconstructor import Reconstructor


class RecordedNetwork:
    """Stands for the `Reconstructor` with a fingerprint: that in `checkpoint`; unless that is given, one of those that come with the
    package, or that in the file `beside` the map, if there is one.

    Raises `InputError` when it is needed and there is none, or when the checkpoint holds another one.
    """

    def __init__(self, fingerprint: str, checkpoint: str | os.PathLike | None = None, beside: Path | None = None):
        # Where these are now: the network may first be needed after a change of the working folder.
        self._checkpoint = checkpoint if checkpoint is None or checkpoint in SHIPPED else Path(checkpoint).absolute()
        self._fingerprint, self._beside = fingerprint, beside and beside.absolute()

    @cached_property
    def found(self) -> Reconstructor:
        """The network itself."""
        from hilbertvae.reconstruction.reconstructor import Reconstructor  # late: answers need no torch

        beside = [self._beside] if self._beside and self._beside.is_file() else []
        for name in [self._checkpoint] if self._checkpoint is not None else [*SHIPPED, *beside]:
            network = Reconstructor.load(name)
            if network.fingerprint() == self._fingerprint:
                return network
        if self._checkpoint is not None:
            raise InputError(f"{self._checkpoint}: expected the network that the map was made with, got another one")
        raise InputError(
            "the map was made with a network that does not come with this version of hilbertvae"
            + (f", and is not in {self._beside}" if self._beside else "")
            + "; to go on with it, give its file: load_map(path, checkpoint=...)"
        )

    def kept_beside(self) -> Path | None:
        """The file beside the map, if it holds this network: who saves the map elsewhere takes it along."""
        if self._beside and self._beside.is_file():
            from hilbertvae.reconstruction.reconstructor import Reconstructor  # late: answers need no torch

            with suppress(InputError):  # a damaged one
                return self._beside if Reconstructor.load(self._beside).fingerprint() == self._fingerprint else None
        return None

    def fingerprint(self) -> str:
        """That of the network."""
        return self._fingerprint

    @property
    def dimension(self) -> int:
        return self.found.dimension

    @property
    def grid(self) -> GridSettings:
        return self.found.grid

    @property
    def resolution_m(self) -> float:
        return self.found.resolution_m

    @property
    def map_weights(self) -> dict:
        return self.found.map_weights

    @property
    def detailed(self) -> bool:
        return self.found.detailed

    def check_cells(self, cells: int) -> None:
        """As `Reconstructor.check_cells`."""
        self.found.check_cells(cells)

    def complete(self, grids: np.ndarray, *how, **named) -> Completion:
        """As `Reconstructor.complete`."""
        return self.found.complete(grids, *how, **named)
