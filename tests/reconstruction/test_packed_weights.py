import torch
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.reconstruction.packed_weights import pack, unpack


@given(
    shape=st.lists(st.integers(1, 5), min_size=2, max_size=5),
    size=st.sampled_from([1e-6, 1.0, 1e4]),
    seed=st.integers(0, 2**31),
)
def test_a_weight_moves_by_less_than_half_a_step_of_its_channel(shape, size, seed):
    weights = {"level.weight": torch.randn(shape, generator=torch.Generator().manual_seed(seed)) * size, "level.bias": torch.randn(3)}
    packed = pack(weights)
    assert packed["level.weight"].dtype == torch.int8 and packed["level.weight.scale"].shape == (shape[0],)
    found = unpack(packed)
    assert found.keys() == weights.keys() and torch.equal(found["level.bias"], weights["level.bias"])
    for channel, original in zip(found["level.weight"], weights["level.weight"], strict=True):
        assert (channel - original).abs().max() <= original.abs().max() / 254 * (1 + 1e-4)


def test_a_channel_of_zeros_stays_so():
    weights = {"w": torch.tensor([[0.0, 0.0], [1.0, -2.0]])}
    assert torch.equal(unpack(pack(weights))["w"][0], torch.zeros(2))


def test_packing_what_was_packed_changes_nothing():
    weights = {"w": torch.randn(4, 3, 3, generator=torch.Generator().manual_seed(0))}
    once = unpack(pack(weights))
    torch.testing.assert_close(unpack(pack(once))["w"], once["w"], rtol=1e-6, atol=1e-7)


def test_weights_that_were_never_packed_pass():
    weights = {"norm.scale": torch.ones(3), "norm": torch.ones(3), "w": torch.ones(2, 2)}
    assert unpack(weights) == weights


def test_whole_numbers_are_left_alone():
    assert pack({"steps": torch.arange(6).reshape(2, 3)})["steps"].dtype == torch.int64
