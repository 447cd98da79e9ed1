"""What a mapper's name says of its row: `cvae-hm...` has a network, `cae-hm...` one without sampling; further words tell its settings."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

NETWORKS = ("cvae-", "cae-")
"""How the names of mappers begin that are made of a trained network."""
POINTS = ("points", "paper")
"""Words in the names of rows that are calibrated for points, those of the paper's map among them; all others are for voxels."""
CHAMPIONS = {"points": ("cvae-hm-points", "cae-hm-points", "cvae-hm-paper", "cae-hm-paper"), "voxels": ("cvae-hm", "cae-hm")}
"""By reading, the row that stands for the run's network: the first of these that was scored; each is calibrated for its reading."""


def is_network(name: str) -> bool:
    """Whether a mapper of this name has a network."""
    return name.startswith(NETWORKS)


def is_rival(name: str) -> bool:
    """Whether networks are compared with a mapper of this name."""
    return competes(name) and not is_network(name)


def competes(name: str) -> bool:
    """Whether a mapper of this name is ranked among others: `gap-centre` is not, which is told where gaps are."""
    return name != "gap-centre"


def reading_of(name: str) -> str:
    """The reading that a mapper of this name is calibrated for."""
    return "points" if any(word in POINTS for word in name.split("-")) else "voxels"


def for_points(name: str) -> str:
    """What the mapper with the network and the settings of this one is called that is calibrated for points."""
    kind, hm, settings = name.partition("-hm")
    return f"{kind}{hm}-points{settings}"


def champions(names: Iterable[str], reading: str) -> list[str]:
    """Those with a network: first the rows that stand for it in this reading, then those that do in another, then the reading's own."""
    known = dict.fromkeys((*CHAMPIONS[reading], *chain(*CHAMPIONS.values())))
    others = sorted((name for name in names if is_network(name) and name not in known), key=lambda name: reading_of(name) != reading)
    return [name for name in known if name in names] + others


def without_sampling(name: str) -> str:
    """The name that `cvae-...` is scored under where the network of the run samples nothing, and so is no CVAE."""
    return name.replace("cvae-", "cae-")


def configured_as(name: str) -> str:
    """The name that a mapper has in the configuration of its run: that of `without_sampling` is none that anybody chose."""
    return "cvae-" + name.removeprefix("cae-") if name.startswith("cae-") else name
