"""What of the poses and times of a bag's scans is doubtful, counted scan by scan and told at once."""

from __future__ import annotations

import warnings
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_poses import BagPoses
from hilbertvae.scans.frame_chains import MOST_NAMED
from hilbertvae.scans.point_times import LONGEST_SWEEP, SWEEP_S
from hilbertvae.scans.poses import MOST_TILT_DEG


@dataclass
class BagDoubts:
    """Numbers of scans of one topic. Those that are `tilted`, and those without a pose, are left out."""

    seen: int = 0
    tilted: int = 0
    """In these the laser leans."""
    untimed: int = 0
    """The times of their points make no sweep."""
    unturned: int = 0
    """Their beams could not be turned back: transforms don't cover the sweep."""
    unposed_ns: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """By frame the times of those without a pose."""

    def warn(self, path: Path, topic: str, finder: BagPoses | None) -> None:
        """One warning for what is doubtful; an `InputError` where no scan has a pose. finder: of the poses, unless odometry was."""
        seen, tilted, unposed = self.seen, self.tilted, sum(map(len, self.unposed_ns.values()))
        if finder and seen and unposed + tilted == seen:
            why = [f"transforms in {finder.fixed_frame} don't cover their times{self._times(finder)}"] if unposed else []
            why += [f"in {tilted} the laser leans more than {MOST_TILT_DEG:.0f} degrees"] if tilted else []
            raise InputError(f"{path}: expected poses for the scans of {topic}, got none of {seen}: {'; '.join(why)}")
        doubts = [f"{unposed} of {seen} scans of {topic} have no pose at their time and are left out"] if unposed else []
        doubts += [f"in {tilted} of {seen} the laser leans more than {MOST_TILT_DEG:.0f} degrees; they are left out"] if tilted else []
        if self.untimed:
            doubts.append(
                f"the times of points in {self.untimed} of {seen} scans make no sweep of {SWEEP_S[0]:g} to {SWEEP_S[1]:g} s around its "
                f"message's, or one more than {LONGEST_SWEEP:g} times as long as the time from scan to scan; these are taken as they are"
            )
        if self.unturned:
            covered = f"transforms don't cover the whole sweep of {self.unturned} of {seen} scans"
            doubts.append(f"{covered}; these are taken as if measured at once")
        doubts += _doubts_of(finder) if finder else []
        if doubts:
            warnings.warn(f"{path}: {'; '.join(doubts)}", stacklevel=3)

    def _times(self, finder: BagPoses) -> str:
        """Of each frame, when its scans were and when there are poses: a lidar's clock may count since it was switched on."""
        said = []
        for frame, stamps in list(self.unposed_ns.items())[:MOST_NAMED]:
            scanned, span = f"scans in {frame} are of {min(stamps) / 1e9:.3f} to {max(stamps) / 1e9:.3f} s", finder.span_ns(frame)
            between = f"{span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s" if span and span[0] <= span[1] else "no time that all of them have"
            said.append(f"{scanned}, transforms of {between}")
        return f": {'; '.join(said)}. For clouds, reading.poses=kiss_icp finds the way"


def _doubts_of(finder: BagPoses) -> list[str]:
    """What was taken for granted of where poses come from."""
    assumed = sorted(finder.assumed.items())
    doubts = [f"no transform says where {name} is on {base or 'the robot'}; taken to be its origin" for name, base in assumed]
    for frame, used in sorted(finder.registered.items()):
        base = finder.tracks[used].base or "the robot"
        doubts.append(f"scans in {frame} are where {used} has its poses: they stay there, and their beams start where it has {base}")
    for frame, sources in sorted(finder.tree.passed_over.items()):
        doubts.append(f"transforms of {frame} are those of {sources.kept}; passed over are other ones in {', '.join(sources.others)}")
    for used, others in finder.others.items():
        doubts.append(f"poses are those of {used}, which has most messages. Set reading.odometry for another: {', '.join(others)}")
    return doubts
