"""The sites that a process opened last: jobs of a sweep take turns in few processes, and most ask for the same two."""

from __future__ import annotations

from hilbertvae.files import hash_of
from hilbertvae.last_few import LastFew
from hilbertvae.site import Site, open_site, site_name
from hilbertvae.training.settings import Settings

KEPT = 2
"""One to validate on and one to test on; a street's clouds and votes take some hundred MB."""
_opened = LastFew(KEPT)


def opened_site(reference: str, settings: Settings) -> Site:
    """The `Site` of a reference, with all that was made of it before if it is one of the last `KEPT`, by contents and resolution."""
    key = hash_of([site_name(reference), settings.resolution_m, settings.source().made_of(reference)])
    return _opened.get(key, lambda: open_site(reference, settings.resolution_m, settings.source()))
