"""What a network's card keeps of how its sites were made or read, and its map's weights learned: a seed, or a path, alone names no site."""

from __future__ import annotations

from dataclasses import asdict

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.training_card import LEARNED_AS as KEY
from hilbertvae.reconstruction.training_card import OLDER, OLDER_SITES
from hilbertvae.scans.formats import ReadingSettings
from hilbertvae.scoring.protocol_settings import check_given
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import SIMULATED, SiteSource
from hilbertvae.training.settings import DataSettings, Settings
from hilbertvae.training.site_roles import place

OF_SITES = ("simulated_scans", "simulated_extent_m", "simulated_variety")
OF_WEIGHTS = ("validation_gap_m", "calibration_seeds", "calibration_given")


def learned_as(settings: Settings) -> dict:
    """What a card keeps of `settings`, as plain values."""
    made = {name: asdict(getattr(settings.data, name)) for name in ("street", "reading")}
    data = made | {key: getattr(settings.data, key) for key in OF_SITES}
    return {"data": data} | {key: getattr(settings, key) for key in OF_WEIGHTS}


def settings_of(card: dict, dimension: int) -> Settings:
    """Settings with what a card keeps of its training's, the defaults where it keeps nothing; an `InputError` for what no setting is."""
    if KEY not in card:
        return Settings(dimension=dimension)
    try:
        data = OLDER_SITES | card[KEY]["data"]
        street, reading = StreetSettings(**data["street"]), ReadingSettings(**data["reading"])
        data = DataSettings(street=street, reading=reading, **{key: data[key] for key in OF_SITES})
        how = OLDER | card[KEY]
        check_given(how["calibration_given"], f"card.{KEY}.calibration_given")
        return Settings(dimension=dimension, data=data, **{key: how[key] for key in OF_WEIGHTS})
    except (KeyError, TypeError) as error:
        raise InputError(f"card.{KEY}: expected what a training of this version keeps there, got {card[KEY]!r:.60} ({error})") from error


def as_made(sites: list[str], source: SiteSource) -> dict[str, dict | None]:
    """One word for all spellings of each site, and how it is made where it is simulated."""
    return {place(site): source.made_of(site)["simulated"] if site.startswith(SIMULATED) else None for site in sites}
