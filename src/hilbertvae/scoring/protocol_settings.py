"""Settings of the protocol (METHOD 7): without mappers, so that who only checks them does not wait for scikit-learn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError, check_positive, check_seeds

GIVEN = ("scans", "map", "fine-map")


@dataclass
class Protocol:
    """Gap seeds, and the gap's size as in the paper: a ratio of the average cluster size."""

    gap_seeds: list[int] = field(default_factory=lambda: [0, 1, 2, 3, 4])
    gap_ratio: float = 0.5
    cluster_size_m: float = 5.0
    centred: bool = False
    """Gaps centred on occupied points, which tells where the wall is; for rows of its own."""
    rim: bool = True
    """Whether voxels that a gap's surface cuts are neither shown nor asked, as METHOD 7 has it. Without, their middles decide, and what is
    asked begins right beside what is shown: gaps are easier. For scores beside those of METHOD 4, whose gaps seem to be such."""
    given: str = "scans"
    """What mappers are given of a site: `scans`, or what an existing map would say of them (`observed_map.map_of`), with cells as large as
    voxels (`map`) or half as large (`fine-map`), as most maps for robots have."""
    occlusion: bool = True
    """Also score real occlusion: what only the scans that were left out have seen."""

    @property
    def gap_diameter_m(self) -> float:
        return self.gap_ratio * self.cluster_size_m

    def __post_init__(self):
        if isinstance(self.gap_seeds, (range, tuple, np.ndarray)):
            self.gap_seeds = list(self.gap_seeds)
        if isinstance(self.gap_seeds, list):  # numpy's numbers are none in JSON
            self.gap_seeds = [int(seed) if isinstance(seed, np.integer) else seed for seed in self.gap_seeds]

    def check(self) -> None:
        """An `InputError` that names the key for what can't be scored."""
        check_positive(self.gap_ratio, "evaluation.gap_ratio")
        check_positive(self.cluster_size_m, "evaluation.cluster_size_m")
        check_seeds(self.gap_seeds, "evaluation.gap_seeds")
        check_given(self.given, "evaluation.given")


def check_given(given: str, name: str) -> None:
    """An `InputError` for what no mapper can be given."""
    if given not in GIVEN:
        raise InputError(f"{name}: expected one of {', '.join(GIVEN)}, got {given!r}")
