from dataclasses import asdict, dataclass

import pytest

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.networks import NETWORKS, build_network, network_settings
from hilbertvae.reconstruction.paper_network import PaperNetwork
from hilbertvae.reconstruction.settings import SCHEMAS, ConditionalNetworkSettings, GatedNetworkSettings, PaperNetworkSettings


@pytest.mark.parametrize(
    ("settings", "network"),
    [
        (GatedNetworkSettings(channels=[4], blocks=[1], latent=2), GatedNetwork),
        (PaperNetworkSettings(channels=[4], kernels=[3], latent=2), PaperNetwork),
    ],
)
def test_settings_make_their_network_and_survive_as_plain_values(settings, network):
    assert network_settings(asdict(settings)) == settings
    assert type(build_network(settings, 2, 8)) is network


@pytest.mark.parametrize("values", [{}, {"kind": "resnet"}])
def test_unknown_kinds_are_named(values):
    with pytest.raises(InputError, match="network.kind: expected one of gated, conditional, paper, got"):
        network_settings(values)


@pytest.mark.parametrize("kind", [GatedNetworkSettings, ConditionalNetworkSettings, PaperNetworkSettings])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"latent": 0}, "network.latent: expected a whole number of at least 1, got 0"),
        ({"dropout": 1.0}, "network.dropout: expected a share from 0 on and below 1, got 1.0"),
        ({"dropout": float("nan")}, "network.dropout: expected a share"),
        ({"channels": [0, 8, 8, 8]}, "network.channels.0.: expected a whole number of at least 1, got 0"),
    ],
)
def test_numbers_that_make_no_network_are_named(kind, change, message):
    with pytest.raises(InputError, match=message):
        build_network(kind(**change), 2, 64)


def test_a_stem_of_no_cells_is_named():
    with pytest.raises(InputError, match="network.stem: expected a whole number of at least 1, got 0"):
        build_network(GatedNetworkSettings(stem=0), 2, 64)


def test_a_kind_that_is_not_that_of_its_settings_is_named():
    with pytest.raises(InputError, match="network.kind: expected 'gated', as the chosen network has, got 'paper'"):
        build_network(GatedNetworkSettings(kind="paper"), 2, 16)


def test_configuration_files_may_choose_each_of_them():
    assert {schema.kind: schema for schema in SCHEMAS} == {kind: schema for kind, (schema, _) in NETWORKS.items()}


class OwnNetwork(GatedNetwork):
    """Somebody's, with the settings of ours."""


def test_kinds_of_one_settings_class_leave_each_other_alone(monkeypatch):
    monkeypatch.setitem(NETWORKS, "own", (GatedNetworkSettings, OwnNetwork))
    few = {"channels": [4], "blocks": [1], "latent": 2}
    assert type(build_network(GatedNetworkSettings(kind="own", **few), 2, 8)) is OwnNetwork
    assert type(build_network(GatedNetworkSettings(**few), 2, 8)) is GatedNetwork
    with pytest.raises(InputError, match="network.kind: expected 'gated' or 'own', as the chosen network has, got 'paper'"):
        build_network(GatedNetworkSettings(kind="paper"), 2, 16)


@dataclass
class Unlisted:
    kind: str = "unlisted"


@pytest.mark.parametrize("settings", [Unlisted(), Unlisted("gated")])
def test_a_network_that_was_not_made_known_is_named(settings):
    with pytest.raises(InputError, match="network: expected settings of a class that NETWORKS has, got Unlisted"):
        build_network(settings, 2, 16)
