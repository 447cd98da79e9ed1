"""YAML files of other programs, without aliases: merged into each other these make of a kilobyte more than any memory holds."""

from __future__ import annotations

from pathlib import Path

import yaml

from hilbertvae.checks import InputError


def check_plain_yaml(path: Path, most_bytes: int) -> str:
    """The text of a file, UTF-8; an `InputError` for a longer one than such files are, and for one with aliases."""
    if path.stat().st_size > most_bytes:
        raise InputError(f"{path}: expected at most {most_bytes} bytes of YAML, got {path.stat().st_size}")
    text = path.read_text(encoding="utf-8")
    if "&" in text and "*" in text and any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)):
        raise InputError(f"{path}: expected YAML without aliases (*name)")
    return text
