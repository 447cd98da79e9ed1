"""The words of `hilbertvae-train` before Hydra reads them."""

from __future__ import annotations

from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.commands.configuration import CONF, SWEEPS

WITH_VALUE = ("-c", "-cd", "-cn", "-cp", "--cfg", "--config-dir", "--config-name", "--config-path")
"""Hydra's options whose value is the next word."""


def options_first(words: list[str]) -> list[str]:
    """The same words with Hydra's options before the settings: argparse calls settings behind a later option unrecognised."""
    options, settings, rest = [], [], iter(words)
    for word in rest:
        is_option = word.startswith("-")
        (options if is_option else settings).append(word)
        if is_option and word in WITH_VALUE:
            options += [value for value in [next(rest, None)] if value is not None]
    return [*options, *settings]


def refuse_shadowed(words: list[str]) -> None:
    """An `InputError` for a file in a folder of `--config-dir` that is called as one of the package's: whichever counted, and Hydra takes
    its own of experiments and the user's of sweeps, the other would be meant as often."""
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, _, value = word.partition("=")
        if option not in ("--config-dir", "-cd"):
            continue
        folder = Path(value or following)
        for own in sorted(folder.rglob("*.yaml")):
            name = own.relative_to(folder)
            if any((theirs / name).exists() and not (theirs / name).samefile(own) for theirs in (CONF, SWEEPS)):
                raise InputError(f"--config-dir: {own}: hilbertvae comes with a {name} of its own; expected another name")
