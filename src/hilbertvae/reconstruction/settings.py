"""Settings of networks and of what they are trained on: without torch, so that who only checks them does not wait for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from hilbertvae.checks import InputError, check_not_negative

LIKELIHOOD_KINDS = ("bernoulli", "gaussian")
"""Those of the package; one of somebody's own is looked for among `LIKELIHOODS`."""
KERNEL = 3
"""Cells along an axis of a residual block's convolutions."""
COUNTED = ("detailed", "shares")
"""Encodings that show how often a cell was hit and passed, so that they take grids with counts (`bin_detailed`)."""


@dataclass
class GatedNetworkSettings:
    """Full-resolution convolutions with many channels are the cost on a CPU; a strided stem and a pixel shuffle avoid them."""

    kind: str = "gated"
    stem: int = 4
    """Cells of the grid, along an axis, that one cell of the first level covers."""
    channels: list[int] = field(default_factory=lambda: [64, 128, 192])
    """One level per entry; each halves the resolution of the one before."""
    blocks: list[int] = field(default_factory=lambda: [2, 2, 2])
    """Residual blocks on the way down per level; the last level's are the bottom's."""
    latent: int = 64
    variational: bool = True
    bottom: str = "summary"
    """What the decoder starts from: `summary`, the bottom's cells and the latent; `flat`, the latent alone, which needs `skips: false`."""
    skips: bool = True
    known: bool = True
    """A second output: whether a cell would be known at all if the site were scanned as training sites were."""
    dropout: float = 0.0
    encoding: str = "hit_free"
    """What the network is shown: `hit_free`, the labels of cells; `detailed`, also how many returns and free samples each cell has, and
    where in it its returns lie; `signed`, the paper's labels; `shares`, the share of each cell's votes that are hits."""

    def convolutions(self, cells: int) -> list[tuple[int, int]]:
        """Kernel and cells, along an axis, of what is convolved on each level, for grids of `cells`."""
        return [(KERNEL, cells // self.stem // 2**level) for level in range(len(self.channels))]


@dataclass
class ConditionalNetworkSettings(GatedNetworkSettings):
    """As the default's, but for where z lies and what it is drawn from."""

    kind: str = "conditional"
    latent: int = 8
    """Of each cell of the bottom: a gap is a few of these, and a vector for a whole grid could not say where in it a wall goes on."""
    guess_share: float = 0.5
    """Share of a training batch that is decoded from the prior's mean, which is what a map asks for."""


@dataclass
class PaperNetworkSettings:
    """The baseline of section IV: 64 cells, kernels 9/7/5/5, channels 64/128/256/256, latent 25 (2D) or 100 (3D)."""

    kind: str = "paper"
    channels: list[int] = field(default_factory=lambda: [64, 128, 256, 256])
    kernels: list[int] = field(default_factory=lambda: [9, 7, 5, 5])
    latent: int = 25
    """The paper's in 2D; in 3D it has 100."""
    dropout: float = 0.8
    """Drop rate after the last encoder convolution; the paper says 0.7 and 0.8 (METHOD 4)."""
    variational: bool = True
    tied: bool = False
    """Decoder convolutions are the encoder's, transposed (`W~ = W^T`, Eq. 2); needs an encoding of one channel."""
    encoding: str = "signed"
    """Labels; `shares`: occupancy probabilities, as the paper's footnote 1 has it."""

    def convolutions(self, cells: int) -> list[tuple[int, int]]:
        """Kernel and cells, along an axis, of what is convolved on each level, for grids of `cells`."""
        return [(kernel, cells // 2**level) for level, kernel in enumerate(self.kernels)]


SCHEMAS = (GatedNetworkSettings, ConditionalNetworkSettings, PaperNetworkSettings)
"""Of the networks that configuration files may choose, each by its default `kind`."""


@dataclass
class LikelihoodSettings:
    """`bernoulli`: logits, on cells known in the target. `gaussian`: the paper's tanh and squared error over all cells."""

    kind: str = "bernoulli"
    observed_weight: float = 0.2
    """`bernoulli`: weight of cells that the input shows, beside 1 for those cut from it. The map keeps observed evidence by itself."""
    known_weight: float = 0.03
    """Weight of the second output's likelihood, per cell that the input does not show; most of these are dull."""
    vote_power: float = 0.0
    """`bernoulli`: known cells weigh as this power of their votes. 0 counts cells, as scores on voxels do, and 1 counts points."""
    masked: bool = True
    """`bernoulli` over known cells alone. Without the mask a cell that nobody saw is to be answered with 0.5, as a gap's then is, too."""

    def __post_init__(self):
        if self.kind not in LIKELIHOOD_KINDS:
            from hilbertvae.reconstruction.likelihood import LIKELIHOODS  # late: torch

            if self.kind not in LIKELIHOODS:
                raise InputError(f"likelihood.kind: expected one of {', '.join(LIKELIHOODS)}, got {self.kind!r}")
        check_not_negative(self.observed_weight, "likelihood.observed_weight")
        check_not_negative(self.known_weight, "likelihood.known_weight")
        if not 0 <= self.vote_power <= 1:
            raise InputError(f"likelihood.vote_power: expected a power in [0, 1], got {self.vote_power}")


@dataclass
class AugmentationSettings:
    """Drawn anew for every batch; all randomness comes from torch's global generators."""

    symmetric: bool = True
    """Flip and swap the horizontal axes."""
    balls: int = 2
    """Gaps cut from each input on top of the clustering's: one always, each further one in half of the grids."""
    ball_diameter_cells: list[float] = field(default_factory=lambda: [10.0, 35.0])
    """Range of their diameters; at cells of 0.1 m, 1 to 3.5 m."""
    count_factor: float = 4.0
    """Where counts are shown, the most by which those of a grid are multiplied or divided: sites are scanned more and less."""

    def __post_init__(self):
        sizes = self.ball_diameter_cells
        if len(sizes) != 2 or not 0 < sizes[0] <= sizes[1]:
            raise InputError(f"augmentation.ball_diameter_cells: expected the smallest and the largest, got {sizes}")
        check_not_negative(self.balls, "augmentation.balls")
        if not self.count_factor >= 1:
            raise InputError(f"augmentation.count_factor: expected at least 1, got {self.count_factor}")
