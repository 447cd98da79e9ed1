"""Which runs may stand in one table: the same protocol, version, site and data. What may differ but should be known becomes a note."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.tables.recipe import settings_but
from hilbertvae.tables.sweep import UNCLEAN, Run, Sweep

OWN = "hilbertvae"
SITE, GAPS = "site", "gaps"
NO_SITE = ("checkpoint", "mapper.")
"""What names among a run's data begin with that are no site: a network may well differ from row to row."""

BUDGET = ("trainer.epochs", "trainer.steps_per_epoch", "trainer.batch_size", "calibration_seeds", "data.simulated")
"""Settings that must agree where rows are of networks that were trained alike: a sweep's folder keeps jobs of earlier calls."""
TRAINED = ("trainer.epochs", "calibration_seeds", "data.simulated")
"""Those that must agree where rows are of networks with recipes of their own, which may have other steps and batches, and of mappers
without one."""


class Made(Protocol):
    """Any file that says what made it, as `provenance` does."""

    name: str
    about: dict


@dataclass(frozen=True)
class Alike:
    """What may differ between the rows of a kind of sweep, and what may not, beside what never may.

    varies: keys that it changes on purpose, such as `protocol.gap_ratio` or `site`. same: settings of every run. trained: settings of those
    runs that trained. but: where all else that decides a network and its map has to agree, too, patterns of the settings that need not; a
    setting that one run lacks is not compared.
    """

    varies: frozenset[str] = frozenset()
    same: tuple[str, ...] = ()
    trained: tuple[str, ...] = ()
    but: tuple[str, ...] | None = None


def check_alike(sweep: Sweep, alike: Alike) -> None:
    """An `InputError` that names the file and the key for the first run that differs from those before it.

    Runs of which nothing was scored give no row, so that nothing is asked of them.
    """
    first: dict[tuple[str, str], tuple[object, Run]] = {}
    for run in sweep.scored:
        for key, value in _facts(run, alike):
            of_site = run.result.site if key == GAPS else ""  # each site has gaps of its own
            known, of = first.setdefault((key, of_site), (value, run))
            if known != value and key not in alike.varies:
                raise InputError(f"{run.path}: {key}: {_short(value)}, but {_short(known)} in {of.path}; they can't stand in one table")


def _facts(run: Run, alike: Alike) -> Iterator[tuple[str, object]]:
    result = run.result
    if OWN not in run.about["packages"]:
        raise InputError(f"{run.path}: packages.{OWN}: missing")
    yield f"packages.{OWN}", run.about["packages"][OWN]
    yield "dimension", result.dimension
    yield "resolution_m", run.config("resolution_m")
    yield "size", run.config("size")
    if run.name == run.job:
        yield SITE, result.site
    for key, value in result.protocol.items():
        yield f"protocol.{key}", value
    # A key that a protocol lacks is a difference too.
    yield "protocol", sorted(result.protocol)
    yield "gap_seeds", result.gap_seeds
    yield "gap_diameter_m", result.gap_diameter_m
    if result.gaps:  # two sites may have one name: what was cut tells them apart
        yield GAPS, [[gaps["seed"], np.round(gaps["centres"], 3).tolist()] for gaps in result.gaps]
    for name, digest in run.about.get("data", {}).items():
        if not name.startswith(NO_SITE):
            yield f"data.{name}", digest
    for key in alike.same:
        yield f"config.{key}", run.config(key)
    # Older results name a training's settings where nothing was trained, too.
    for key in alike.trained if run.stage_seconds("train") else ():
        if (value := run.config(key)) is not None:
            yield f"config.{key}", value
    if alike.but is not None:
        yield from ((f"config.{key}", value) for key, value in settings_but(run.about, alike.but))


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def origin_notes(runs: Sequence[Made]) -> list[str]:
    """What made the rows: version and commits, trees that were dirty, packages and machines that differ."""
    if not runs:
        return []
    versions = sorted({run.about["packages"][OWN] for run in runs})
    commits = sorted({(run.about.get("git") or {}).get("commit", "unknown")[:12] for run in runs})
    lines = [f"- hilbertvae {', '.join(versions)}, commit{'s' if len(commits) > 1 else ''} {', '.join(commits)}"]
    dirty = [run.name for run in runs if is_unclean(run)]
    if dirty:
        lines.append(f"- {UNCLEAN}, so that no commit says what ran: {', '.join(dirty)}")
    packages: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for name in sorted({name for run in runs for name in run.about["packages"]} - {OWN}):
        for run in runs:
            packages[name][run.about["packages"].get(name, "none")].append(run.name)
    for name, versions in packages.items():
        if len(versions) > 1:
            lines.append(f"- {name} differs: " + "; ".join(f"{version} in {_names(runs)}" for version, runs in sorted(versions.items())))
    hosts = sorted({_host(run) for run in runs if run.about.get("host")})
    if hosts:
        also = "" if len(hosts) == 1 else "; seconds of different machines can't be compared"
        lines.append(f"- measured on {'; '.join(hosts)}{also}")
    return lines


def is_unclean(run: Made) -> bool:
    """Whether the run's code was changed after its commit."""
    return bool((run.about.get("git") or {}).get("dirty"))


def _host(run: Made) -> str:
    host = run.about["host"]
    threads = host.get("threads", "?")
    gpus = "".join(f", {key.replace('_', ' ')} {host[key]}" for key in ("filled_by", "trained_by") if key in host)
    return f"{host.get('cpu', 'an unknown processor')}, {threads} thread{'' if threads == 1 else 's'}, networks in {host['numbers']}{gpus}"


def _names(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{names[0]} and {len(names) - 1} more"
