"""`hilbertvae-map`: scans in, a gap-filled map out, in the formats of other tools."""

from __future__ import annotations

import json
import re
import sys
import warnings
from dataclasses import fields
from pathlib import Path

from rich.console import Console
from rich.text import Text

from hilbertvae.checks import InputError
from hilbertvae.commands.keywords import from_home, run_command
from hilbertvae.map_settings import MapSettings
from hilbertvae.scans.formats import ReadingSettings
from hilbertvae.terminal import show_any_text

ABOUT = (
    "Map the scans at a path and fill in what the sensor could not see. Nothing but scans= is needed, unless a cloud alone\n"
    "does not say where its beams started: then sensor_origin_m=, too."
)

LEFT_OUT = {"near_left_out": "as near as min_range_m or nearer", "far_left_out": "as far as max_range_m or farther"}
"""How the summary counts returns that ranges dropped, and what the report calls them."""
GROUPED = rf"\breading\.({'|'.join(part.name for part in fields(ReadingSettings))})\b"


def _alone(text: str) -> str:
    """Settings that are a group elsewhere stand alone here."""
    return re.sub(GROUPED, r"\1", text)


def run(settings: MapSettings) -> None:
    """Make the map, say what it came out as."""
    from hilbertvae.exports.map_folder import SUMMARY  # late: whoever asks for help does not wait for torch
    from hilbertvae.mapping import make_map

    settings = from_home(settings, "scans", "output", "weights")
    console = Console(stderr=True)
    warnings.showwarning = lambda message, *rest, **named: console.print(Text(_alone(str(message)), "yellow"), soft_wrap=True)
    try:
        with console.status("start") as status:
            output = make_map(settings, lambda stage: status.update(Text(f"{settings.scans}: {stage}")))
    except InputError as error:
        raise InputError(_alone(str(error))) from error
    summary = json.loads((output / SUMMARY).read_text(encoding="utf-8"))
    show_any_text()  # a folder may have a name of another encoding
    print(report(summary, output))


def report(summary: dict, output: Path) -> str:
    """What was filled in, how long it took and what was written, as lines of text."""
    cell = summary["resolution_m"] ** summary["dimension"]
    unit = "m2" if summary["dimension"] == 2 else "m3"
    before, after = summary["cells"]["before"], summary["cells"]["after"]
    lines = [f"{summary['name']}: {summary['dimension']}D, cells of {summary['resolution_m']:g} m"]
    lines += [f"  {kind:8} before {before[kind] * cell:12,.1f} {unit}, after {after[kind] * cell:12,.1f} {unit}" for kind in before]
    points = summary["points"]
    dropped = [f"{points[key]:,} {said}" for key, said in LEFT_OUT.items() if key in points]
    lines += [f"  returns left out: {', '.join(dropped)}"] if dropped else []
    lines += ["  " + ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in summary["seconds"].items())]
    return "\n".join([*lines, *(f"  {output / name}" for name in summary["files"])])


def main(words: list[str] | None = None) -> int:
    """Entry point; the exit code, 2 for what can't be read, mapped or written."""
    return run_command("hilbertvae-map", MapSettings, ABOUT, run, words)


if __name__ == "__main__":
    sys.exit(main())
