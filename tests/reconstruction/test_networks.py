from dataclasses import asdict

import pytest

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.gated_network import GatedNetwork, GatedNetworkSettings
from hilbertvae.reconstruction.networks import build_network, network_settings
from hilbertvae.reconstruction.paper_network import PaperNetwork, PaperNetworkSettings


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


def test_a_kind_that_is_not_that_of_its_settings_is_named():
    with pytest.raises(InputError, match="network.kind: expected 'gated', as the chosen network has, got 'paper'"):
        build_network(GatedNetworkSettings(kind="paper"), 2, 16)
