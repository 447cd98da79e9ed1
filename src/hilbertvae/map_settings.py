"""What `hilbertvae-map` is told; apart from what it does, so that its help does not wait for torch."""

from __future__ import annotations

from dataclasses import dataclass, fields

from hilbertvae.scans.formats import ReadingSettings


@dataclass
class MapSettings(ReadingSettings):
    """One run of `hilbertvae-map`; how scans are read is inherited."""

    scans: str = ""
    """A file or a folder of scans, or a map to be filled: an OctoMap `.ot` or `.bt`, a ROS map's `.yaml`. Of maps that
    were filled before, give the `_observed` one: what a map holds is taken as seen. Cells count from (0, 0): where a ROS map's `origin` is
    no whole number of cells, its walls move by up to half a cell, with a warning, and its unknown margin is not kept. In 3D
    z has to point up."""
    output: str | None = None
    """Folder to write to; `outputs/maps/<name of the scans>` unless given."""
    weights: str | None = None
    """A network that comes with the package, or the `model.safetensors` of a training; `2d` or `3d`, as the data are, and `2d-map` for
    a map of 2D, unless given."""
    resolution_m: float | None = None
    """Side of the map's cells; the network's own (0.1 in 2D, 0.2 in 3D), or that of a map to be filled, unless given."""
    fill: bool = True
    """`off` gives the observed map alone, to which no more scans can be added."""
    adapt_steps: int = 0
    """For how many steps the network first learns from the scans themselves, from gaps cut for that; 50 bring most of what there is to
    gain, in seconds to half a minute in 2D, by processor. That network is written as `adapted.safetensors`: keep it beside the map, which
    needs it to grow."""
    calibration: str = "voxels"
    """What the map is made for. `voxels`: a probability is the share of cells that are occupied. `points`: the cut of 0.6 finds most
    of what beams would hit. It fills in more than twice as much, and more of that is wrong (a street's gaps, by cells: recall 83 %
    for 45 %, precision 64 % for 87 %); of a building's seen cells 12 % more are occupied."""
    exports: list[str] | None = None
    """Which formats are written, as `exports=ros,points`, of ros, ot, bt, points, mesh, npz and rerun; all that suit the map and need no
    extra, unless given."""
    device: str = "cpu"
    """Where the network computes: `cpu`, or `cuda` where there is one."""

    def reading(self) -> ReadingSettings:
        """How scans are read."""
        return ReadingSettings(**{part.name: getattr(self, part.name) for part in fields(ReadingSettings)})
