"""The sites that a process opened last: jobs of a sweep take turns in few processes, and most ask for the same two."""

from __future__ import annotations

from hilbertvae.files import hash_of
from hilbertvae.site import Site, open_site, site_name
from hilbertvae.training.settings import Settings

KEPT = 2
"""One to validate on and one to test on; a street's clouds and votes take some hundred MB."""
_opened: dict[str, Site] = {}


def opened_site(reference: str, settings: Settings) -> Site:
    """The `Site` of a reference, with all that was made of it before if it is one of the last `KEPT`, by contents and resolution."""
    key = hash_of([site_name(reference), settings.resolution_m, settings.source().made_of(reference)])
    site = _opened.pop(key, None) or open_site(reference, settings.resolution_m, settings.source())
    _opened[key] = site
    while len(_opened) > KEPT:
        del _opened[next(iter(_opened))]
    return site
