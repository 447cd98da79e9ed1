import numpy as np
import pytest
import torch

from hilbertvae.reconstruction import precision
from hilbertvae.reconstruction.blocks import convolutions
from hilbertvae.reconstruction.precision import fast_autocast, fast_type, layer_type, training_type
from hilbertvae.reconstruction.settings import GatedNetworkSettings, PaperNetworkSettings
from toy_rooms import tiny_reconstructor


@pytest.mark.parametrize(
    ("features", "wanted"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, torch.bfloat16),
        ({"avx512_bf16": True, "amx_bf16": False}, torch.bfloat16),
        ({"architecture": "aarch64", "bf16": True}, torch.bfloat16),
        ({"avx512_f": True, "avx512_vnni": True, "amx_bf16": False, "avx512_bf16": False}, torch.float32),
        ({}, torch.float32),
    ],
)
def test_processors_that_multiply_in_bfloat16_do_so(monkeypatch, features, wanted):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features, raising=False)
    assert fast_type() is wanted
    layer = torch.nn.Conv2d(1, 1, 3)
    with torch.inference_mode(), fast_autocast():
        assert layer(torch.zeros(1, 1, 5, 5)).dtype is wanted


def test_a_torch_that_does_not_say(monkeypatch):
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    assert fast_type() is torch.float32


@pytest.mark.parametrize(
    ("network", "cells", "right"),
    [
        (GatedNetworkSettings(stem=4, channels=[8, 8]), 32, True),  # 8, 4
        (GatedNetworkSettings(stem=4, channels=[8, 8]), 16, False),  # 4, 2
        (GatedNetworkSettings(stem=4, channels=[8, 8, 8]), 16, False),  # 4, 2, 1
        (PaperNetworkSettings(), 64, True),  # kernels 9, 7, 5, 5 on 64, 32, 16, 8
        (PaperNetworkSettings(), 32, False),
    ],
)
def test_kernels_wider_than_their_level_are_trained_in_single_precision(monkeypatch, network, cells, right):
    """Else torch's gradients of 3D convolutions are wrong, on CPUs alone."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True}, raising=False)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: True)
    assert training_type("cpu", 3, convolutions(network, cells)) is (torch.bfloat16 if right else torch.float32)
    assert training_type("cpu", 2, convolutions(network, cells)) is torch.bfloat16
    assert training_type("cuda", 3, convolutions(network, cells)) is torch.bfloat16
    assert convolutions(object(), cells) == []


def test_layers_take_the_numbers_of_the_autocast_that_runs():
    cpu = torch.device("cpu")
    assert layer_type(cpu) is torch.float32
    with torch.autocast("cpu", torch.bfloat16):
        assert layer_type(cpu) is torch.bfloat16
        with torch.autocast("cpu", enabled=False):
            assert layer_type(cpu) is torch.float32


def test_devices_of_other_kinds(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: not including_emulation)
    assert fast_type("cuda:1") is torch.bfloat16
    assert fast_type("mps") is torch.float32


def test_both_kinds_of_numbers_say_nearly_the_same(monkeypatch):
    network, said = tiny_reconstructor(), []
    grids = np.random.default_rng(0).integers(-1, 2, (8, 16, 16)).astype(np.int8)
    for features in ({"avx512_bf16": True}, {}):
        monkeypatch.setattr(precision.torch.cpu, "get_capabilities", lambda features=features: features, raising=False)
        said.append(network.reconstruct(grids))
    assert (said[0] != said[1]).any()
    np.testing.assert_allclose(*said, atol=0.1)
