"""Fixtures of the tests of Hilbert Maps."""

import pytest
from hilbert_map_toys import fit, gapped, reconstructor

from hilbertvae.mappers.hilbert_map import HilbertMap
from toy_rooms import tiny_grid


@pytest.fixture(scope="module", params=["reconstructed", "raw", "cluster"])
def fitted(request, place):
    """A fitted map, and its place."""
    network = None if request.param == "raw" else reconstructor(place.dimension)
    weights = "cluster" if request.param == "cluster" else "rank"
    grid = tiny_grid(place.dimension) if network is None else None
    return fit(HilbertMap(network, weights=weights, grid=grid), gapped(place)), place
