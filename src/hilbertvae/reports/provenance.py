"""What made a result: the code, the packages, the machine and the data, as plain values for `result.json`."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path

from hilbertvae.files import hash_of

PACKAGES = (
    "hilbertvae", "numpy", "scipy", "scikit-learn", "torch", "lightning", "hydra-core", "omegaconf", "safetensors",
    "matplotlib", "tensorboard", "trimesh", "embreex", "octomap-python",
)  # fmt: skip
"""Those that numbers can depend on; one that is not installed is left out."""


def provenance(
    config: dict,
    *,
    identity: dict | None = None,
    data: dict[str, str] | None = None,
    seeds: dict[str, int] | None = None,
    seconds: dict[str, float] | None = None,
    device: str = "cpu",
) -> dict:
    """Everything of `result.json` that no `Result` knows.

    config: the resolved settings as plain containers. identity: the part of them that can change numbers (not paths, launcher, device),
    which is hashed; all of them unless given. data: sha256 by file name. seeds: by what they seed. seconds: wall time by stage.
    device: where networks filled maps.
    """
    import torch  # late: who only reads result files does not wait for it

    from hilbertvae.reconstruction.precision import device_name, fast_type

    on_cpu = torch.device(device).type == "cpu"
    return {
        "config": without_folders(config),
        "config_hash": hash_of(config if identity is None else identity),
        **made_by(),
        "packages": package_versions(),
        "python": platform.python_version(),
        "host": {
            "name": platform.node(),
            "system": platform.platform(),
            "cpu": cpu_name(),
            "cpus": os.cpu_count(),
            "threads": torch.get_num_threads(),
            "numbers": str(fast_type(device)).removeprefix("torch."),  # that networks run in there
            **({} if on_cpu else {"filled_by": device_name(device)}),
        },
        "data": data or {},
        "seeds": seeds or {},
        "stage_seconds": seconds or {},
        "peak_memory_mb": peak_memory_mb(),
    }


def made_by() -> dict:
    """The command that runs, and the commit of the code that it runs."""
    return {"command": [Path(sys.argv[0]).name, *without_folders(sys.argv[1:])], "git": git_state(Path(__file__).parent)}


def without_folders(node):
    """Absolute paths as bare names, also behind `key=`, anywhere in plain containers: where something lies says nothing elsewhere."""
    if isinstance(node, dict):
        return {key: without_folders(value) for key, value in node.items()}
    if isinstance(node, (list, tuple)):
        return [without_folders(value) for value in node]
    if isinstance(node, str):
        key, mark, value = node.rpartition("=")
        return key + mark + Path(value).name if Path(value).is_absolute() else node
    return node


def named_without_folders(found: dict[str, str]) -> dict[str, str]:
    """Values by the bare names of their places; of two places with one name, a later one's is counted: "attic.log (2)"."""
    named: dict[str, str] = {}
    for place, value in found.items():
        bare = name = without_folders(place)
        count = 1
        while named.get(name, value) != value:
            count += 1
            name = f"{bare} ({count})"
        named[name] = value
    return named


def git_state(folder: Path) -> dict | None:
    """The commit of the repository that tracks the files in `folder`, and whether its tree was dirty; None where none does.

    An installed copy may lie inside a user's own repository, whose commit says nothing about this package.
    """
    if not _git(folder, "ls-files", "."):
        return None
    commit = _git(folder, "rev-parse", "HEAD")
    return {"commit": commit, "dirty": bool(_git(folder, "status", "--porcelain"))} if commit else None


def _git(folder: Path, *command: str) -> str | None:
    """What git says. It only looks: whoever works in the repository meanwhile finds no lock of this."""
    try:
        done = subprocess.run(["git", "--no-optional-locks", *command], cwd=folder, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def package_versions() -> dict[str, str]:
    """Versions of the installed ones of `PACKAGES`."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def cpu_name() -> str:
    """The processor's model as Linux knows it, else the platform's word for it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor() or platform.machine()
    )


def peak_memory_mb() -> float | None:
    """The largest resident memory of this process or of any one child that has ended, in MB (1e6 bytes)."""
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB on Linux
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    most = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return round(most * unit / 1e6, 1)
