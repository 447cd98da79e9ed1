"""Settings as the command makes them of its words."""

from hydra import compose, initialize_config_dir

from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.training.settings import Settings


def settings_of(*overrides: str) -> Settings:
    """What these words make of the configuration."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return to_settings(compose("config", overrides=list(overrides)))


def key_of(word: str) -> str:
    """`a.b` of `++a.b=1` and of `a={b: 1}`."""
    return word.lstrip("+").replace("={", ".").split(":")[0].split("=")[0]
