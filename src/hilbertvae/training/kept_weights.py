"""A Hilbert Map's weights as a run learned them, kept beside its checkpoints: a run that is stopped while it scores goes on with them."""

from __future__ import annotations

from pathlib import Path

from hilbertvae.files import hash_of, json_object, write_json
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reports.provenance import package_versions
from hilbertvae.reports.run_folder import CHECKPOINTS
from hilbertvae.training.kept_scores import CODE, described, is_known
from hilbertvae.training.settings import Settings
from hilbertvae.training.training_hash import training_hash


class KeptWeights:
    """The place of the weights of a run's map, filed under all that they depend on: its network, its settings, and the code."""

    def __init__(self, settings: Settings, mapper: HilbertMap):
        self.path = Path(settings.output) / CHECKPOINTS / "map_weights.json"
        made_of = [CODE, package_versions(), training_hash(settings), described(mapper)]
        self._of = hash_of(made_of) if is_known(mapper) else None

    def take(self) -> tuple[dict, float] | None:
        """The weights by reading, and how many seconds it took to learn them; None where there are none of this network."""
        found = json_object(self.path)
        weights, seconds = found.get("weights"), found.get("seconds")
        whole = isinstance(weights, dict) and isinstance(seconds, (int, float))  # else they are learned anew
        return (weights, seconds) if whole and self._of and found.get("of") == self._of else None

    def keep(self, weights: dict, seconds: float) -> None:
        """Written whole or not at all."""
        if self._of:
            write_json(self.path, {"of": self._of, "weights": weights, "seconds": seconds})
