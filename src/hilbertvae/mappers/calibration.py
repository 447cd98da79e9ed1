"""The `rank` weights of the Hilbert Map, learned on the validation site, which the network has not been trained on (METHOD 5)."""

from __future__ import annotations

import numpy as np

from hilbertvae.gaps import OUTSIDE, RIM, random_gaps
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.weights import fit_rank_weights
from hilbertvae.site import Site

MOST_QUERIES = 400_000


def learn_rank_weights(mapper: HilbertMap, site: Site, gap_diameter_m: float, seeds: list[int]) -> dict[str, dict]:
    """Plain rank weights by reading (`points`, `voxels`), from gapped inputs and what the gaps and the held-out beams hid.

    One network serves both readings; only these weights differ, since a probability is calibrated for what it was fitted on.
    """
    gathered: dict[str, list] = {"points": [], "voxels": []}
    for seed in seeds:
        gaps = random_gaps(site.fit, gap_diameter_m, site.resolution_m, seed)
        shown = gaps.cut(site.fit)
        mapper.set_params(seed=seed).fit(shown.points, shown.occupied, shown.weight)
        for reading, cloud, held_out in (
            ("points", site.points, site.points_held_out),
            ("voxels", site.voxels, site.voxels_held_out),
        ):
            part = gaps.part(cloud.points)
            asked = np.flatnonzero((part != RIM) & (held_out | (part != OUTSIDE)))
            if len(asked) > MOST_QUERIES // len(seeds):
                asked = np.random.default_rng(seed).choice(asked, MOST_QUERIES // len(seeds), replace=False)
            gathered[reading].append((*mapper.features(cloud.points[asked]), cloud.occupied[asked]))
    learned = {}
    for reading, portions in gathered.items():
        learned[reading] = fit_rank_weights(*(np.concatenate(column) for column in zip(*portions, strict=True))).plain()
    return learned
