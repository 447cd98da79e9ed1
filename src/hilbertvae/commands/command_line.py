"""The words of `hilbertvae-train` before Hydra reads them."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.commands.configuration import CONF, SWEEPS

WITH_VALUE = ("-c", "-cd", "-cn", "-cp", "-p", "--cfg", "--config-dir", "--config-name", "--config-path", "--package")
"""Hydra's options whose value is the next word."""
INFO = ("-i", "--info")
ABOUT = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
"""The option that may have a value, and what it may be."""


def options_last(words: list[str]) -> list[str]:
    """The same words with Hydra's options behind the settings: argparse calls settings on both sides of one unrecognised."""
    options, settings, is_value = [], [], False
    for word, following in pairwise([*words, ""]):
        (options if is_value or word.startswith("-") else settings).append(word)
        is_value = not is_value and (word in WITH_VALUE or (word in INFO and following in ABOUT))
    return [*settings, *options]


def refuse_shadowed(words: list[str]) -> None:
    """An `InputError` for a file in a folder of `--config-dir` that is called as one of the package's: whichever counted, and Hydra takes
    its own of experiments and the user's of sweeps, the other would be meant as often."""
    for word, following in pairwise([*words, ""]):
        option, _, value = word.partition("=")
        if option not in ("--config-dir", "-cd"):
            continue
        folder = Path(value or following)
        found = [Path(place, file) for place, _, files in os.walk(folder, followlinks=True) for file in files if file.endswith(".yaml")]
        for own in sorted(found):
            name = own.relative_to(folder)
            if any((theirs / name).exists() and not (theirs / name).samefile(own) for theirs in (CONF, SWEEPS)):
                raise InputError(f"--config-dir: {own}: hilbertvae has its own {name}; expected another name")
