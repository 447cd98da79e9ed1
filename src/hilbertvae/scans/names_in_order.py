"""The order of scans that are told apart by the numbers in their names."""

from __future__ import annotations

import re
import warnings
from decimal import Decimal
from pathlib import Path

START, END = r"(?<![0-9])(?<![0-9]\.)", r"(?![0-9])(?!\.[0-9])"
"""Of what may be a decimal number; 2026.11.20 is none."""
WHOLE, DECIMAL = "[0-9]+", rf"{START}[0-9]+\.[0-9]+{END}|[0-9]+"
FRACTION = re.compile(rf"{START}[0-9]+\.([0-9]+){END}")
MINUS = re.compile("(?<![0-9A-Za-z-])-(?=[0-9])")
"""As in scan_-2, and not in scan-2, scan--2 and 2026-11-20. Where all names have it, it stands between words."""


def names_in_order(files: list[Path]) -> list[Path]:
    """Files in the order of their names, in which a number counts as a number: -1.pcd stands before 2.pcd, and that before 10.pcd.

    Numbers like 12.75 are decimals, as times are, unless they count on: in 1.9, 1.10 and 1.11 the second number is one of its own. How
    the digits after the point begin and end tells which, where some names have more of them than others: a count has no 0 ahead, and a
    decimal lost those at its end. Warns where names leave that open.
    """
    number = DECIMAL if _are_decimals(files) else WHOLE
    signed = not all(MINUS.search(path.stem) for path in files)
    numbers = re.compile(f"((?:{MINUS.pattern})?(?:{number}))" if signed else f"({number})")
    return sorted(files, key=lambda path: (_parts(path.stem, numbers), path.name))


def _are_decimals(files: list[Path]) -> bool:
    fractions = [digits for path in files for digits in FRACTION.findall(path.stem)]
    if len({len(digits) for digits in fractions}) < 2:
        return True  # as whole numbers they come in the same order
    longer = [digits for digits in fractions if len(digits) > 1]
    decimal, counted = any(digits[0] == "0" for digits in longer), any(digits[-1] == "0" for digits in longer)
    if decimal == counted:
        first = next(path for path in files if FRACTION.search(path.stem))
        warnings.warn(
            f"{first.parent}: numbers in names like {first.name} are read as decimals, 1.25 before 1.3; pad those that count on with zeros",
            stacklevel=5,
        )
    return decimal or not counted


def _parts(stem: str, numbers: re.Pattern) -> list:
    """Text and numbers in turn, so that like is compared with like."""
    return [Decimal(part) if place % 2 else part for place, part in enumerate(numbers.split(stem))]
