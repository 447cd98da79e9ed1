"""What a network's card, kept with its weights, says of how it was trained, and which settings say nothing of that."""

from __future__ import annotations

import re

MANY = re.compile(r"(\d+) simulated [a-z ]+?(?: from (\d+) on)?")
"""How `many_simulated` says it."""
LEARNED_AS = "learned_as"
"""In a card: how the sites were made or read, and with which gap seeds its map's weights were learned; those that are older have none."""
OLDER = {"calibration_given": "scans"}
"""What of `LEARNED_AS` older cards lack, and how it was then."""
OLDER_SITES = {"simulated_variety": "usual"}
"""The same of its `data`."""
ELSEWHERE = {"data": ("folder", "download", "cache", "processes", "test"), "trainer": ("accelerator", "strategy")}
"""Settings of a training, by their part, of where things lie, or of what computes."""
ANEW = "weights_learned_anew"
"""In the card of a network in a run's memory: whether the run learned other map's weights for it, with seeds of its own."""


def stages(card: dict) -> list[dict]:
    """What the network was trained on, first things first."""
    before = card.get("started_from")
    return [*(stages(before) if before else []), card]


def many_simulated(kind: str, count: int, first: int) -> str:
    """How a network's card says that it was trained on simulated sites `first`, `first` + 1, ..., `count` of them, which are of a kind."""
    return f"{count} simulated {kind}" + (f" from {first} on" if first else "")


def trained_on(card: dict) -> tuple[set[str], list[range]]:
    """References of the sites that a network was trained on in any step, and the numbers of the simulated ones that its card counts."""
    sites, simulated = set(), []
    for site in (site for stage in stages(card) for site in stage.get("trained_on", [])):
        if several := MANY.fullmatch(site):
            first = int(several[2] or 0)
            simulated.append(range(first, first + int(several[1])))
        else:
            sites.add(site)
    return sites, simulated


def calibrated_on(card: dict) -> list[str]:
    """The sites that its map's weights were learned on: that of the best weights where the card is older than the choice."""
    return card.get("calibrated_on") or [card[key] for key in ("validated_on",) if key in card]
