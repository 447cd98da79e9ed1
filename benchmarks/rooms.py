"""How well 3D networks fill rooms: scores in the gaps of simulated floors of buildings.

    python benchmarks/rooms.py [--floors 6] [--networks 3d 3d-sim] [--quick]

No real scans of rooms in space are at hand. Floors are those of `data.street.variety=floors` from seed 900040 on; nothing is trained or
chosen on them. They have one scan, or up to twelve. Gaps are those of the protocol, 2.5 m, and so are scores, of voxels by maps for voxels
and of points by maps for points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from measuring import arguments, report

from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scoring.protocol import evaluate_all
from hilbertvae.scoring.protocol_settings import Protocol
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import SIMULATED, Site, SiteSource

FIRST = 900040
RESOLUTION_M = 0.2
SCORES = ("auc", "best_f1", "nll", "ece")


def scored(site: Site, networks: Sequence[str], seeds: list[int]) -> list[dict]:
    """A row per method: its scores in gaps, voxels and points, means over gap seeds."""
    ours = {(name, reading): load_mapper(name).set_params(calibration=reading) for name in networks for reading in ("voxels", "points")}
    others = {"15 nearest neighbours": NearestMapper(15), "Hilbert Map (fixed grid)": FixedGridMapper()}
    mappers = {f"{name}, {reading}": mapper for (name, reading), mapper in ours.items()} | others
    found = evaluate_all(mappers, site, Protocol(gap_seeds=seeds, occlusion=False)).scores
    rows = []
    for name in (*networks, *others):
        row = {"floor": site.name, "method": name}
        for reading in ("voxels", "points"):
            gaps = found[f"{name}, {reading}" if name in networks else name][reading]["gaps"]
            row |= {f"{reading}: {score}": float(np.mean(gaps[score])) for score in SCORES}
        rows.append(row)
    return rows


def means(rows: list[dict]) -> list[dict]:
    """A row per method: the means of its rows."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    of = {method: [row for row in rows if row["method"] == method] for method in methods}
    kept = [key for key in rows[0] if key not in ("floor", "method")]
    return [
        {"floor": "mean", "method": method, **{key: float(np.mean([row[key] for row in of[method]])) for key in kept}} for method in methods
    ]


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--floors", type=int, default=6)
    parser.add_argument("--networks", nargs="+", default=["3d", "3d-sim"])
    given = parser.parse_args(words)
    floors, networks, seeds = (1, ["3d-sim"], [0]) if given.quick else (given.floors, given.networks, [0, 1])
    street = StreetSettings(variety="floors", scans=2 if given.quick else 12, azimuths=90 if given.quick else None)
    source, rows, facts = SiteSource(3, street=street), [], {}
    for reference in (f"{SIMULATED}{FIRST + number}" for number in range(floors)):
        site = Site(reference, source.scans(reference), RESOLUTION_M)
        extent = np.ptp(site.scans.points, axis=0).round(1).tolist()
        facts[reference] = {"scans": int(site.scans.scan.max()) + 1, "returns": len(site.scans), "extent_m": extent}
        facts[reference]["occupied share of voxels"] = float(site.voxels.occupied.mean())
        rows += scored(site, networks, seeds)
    report("rooms", given, [*rows, *means(rows)], [], facts | {"gap_seeds": seeds})


if __name__ == "__main__":
    main()
