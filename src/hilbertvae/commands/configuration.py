"""The configuration of `hilbertvae-train`: where its files lie, the schema that they are checked against, and settings from it."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.reconstruction.settings import SCHEMAS
from hilbertvae.training.settings import Settings

PACKAGE = Path(hilbertvae.__file__).parent
# The wheel carries the folders inside the package; a checkout has them at the top.
CONF, SWEEPS = (PACKAGE / name if (PACKAGE / name).is_dir() else PACKAGE.parents[1] / name for name in ("conf", "sweeps"))
OmegaConf.register_new_resolver("sweeps_folder", lambda: str(SWEEPS), replace=True)

store = ConfigStore.instance()
# The network is missing there, so that a choice of another kind meets no default of this one; the folder is that of the name, and the
# voxels are those of the dimension, that will be chosen.
SCHEMA = Settings(network=MISSING)
SCHEMA.output, SCHEMA.resolution_m = "outputs/${name}", None
store.store(name="settings_schema", node=SCHEMA)
for schema in SCHEMAS:
    store.store(group="network", name=f"{schema.kind}_schema", node=schema)


def to_settings(config: DictConfig) -> Settings:
    """The configuration as plain dataclasses, checked."""
    try:
        settings = OmegaConf.to_object(config)
    except InputError as error:  # of a street, which is complete when it is made, and does not know where it lies
        raise InputError(f"data.{error}" if str(error).startswith("street.") else str(error)) from error
    _refuse_unknown(settings, "")
    if not is_dataclass(settings.network):  # a file of one's own that says nothing of its kind
        schemas = ", ".join(f"{schema.kind}_schema" for schema in SCHEMAS)
        raise InputError(f"network: its file needs `defaults: [...]` with the kind that it is of, one of {schemas}")
    settings.check()
    return settings


def _refuse_unknown(node: object, path: str) -> None:
    """Hydra's `+key=value` adds a key to a typed node without complaint; no setting that nothing reads is let through."""
    known = {part.name for part in fields(node)}
    for name, value in vars(node).items():
        if name not in known:
            raise InputError(f"{path}{name}: unknown key; expected one of {', '.join(sorted(known))}")
        if is_dataclass(value):
            _refuse_unknown(value, f"{path}{name}.")
