"""HM, the Hilbert Map of Ramos & Ott (2015): radial basis features on a fixed grid of centres, and a logistic regression."""

from __future__ import annotations

from hilbertvae.checks import check_positive
from hilbertvae.mappers.grid_features import SMALLEST, GridFeatures, grid_nodes
from hilbertvae.mappers.logistic import LogisticMapper
from hilbertvae.mappers.radial_features import RadialFeatures


class FixedGridMapper(LogisticMapper):
    """HM. Far from any centre the answer is the intercept's, about `occupied_share`.

    spacing_m, gamma_per_m2: of the grid and of the features (METHOD 6).
    weight_power: a fit point that stands for n samples weighs n^weight_power; 0 is none, 1 the plain count.
    occupied_share: the share of the total weight that occupied points are given. A thinned cloud is mostly free, and without this the
        map calls few walls occupied at the 0.6 cut; None leaves it so.
    penalty, l1_share: the elastic net. epochs, batch_size, rate, seed: of the gradient descent (see `fit_logistic`).
    """

    def __init__(
        self,
        spacing_m=0.5,
        gamma_per_m2=4.0,
        weight_power=0.5,
        occupied_share=0.4,
        penalty=1e-6,
        l1_share=0.15,
        epochs=10,
        batch_size=1024,
        rate=5.0,
        seed=0,
    ):
        self.spacing_m = spacing_m
        self.gamma_per_m2 = gamma_per_m2
        self.weight_power = weight_power
        self.occupied_share = occupied_share
        self.penalty = penalty
        self.l1_share = l1_share
        self.epochs = epochs
        self.batch_size = batch_size
        self.rate = rate
        self.seed = seed

    def check_settings(self) -> None:
        super().check_settings()
        check_positive(self.spacing_m, "spacing_m")
        check_positive(self.gamma_per_m2, "gamma_per_m2")

    def _feature_map(self, points, occupied, weight):
        if points.shape[1] <= 3:
            return GridFeatures(points, self.spacing_m, self.gamma_per_m2)
        # With more axes the nodes within reach outnumber those that there are: these are searched.
        return RadialFeatures(grid_nodes(points, self.spacing_m) * self.spacing_m, self.gamma_per_m2, SMALLEST, self.spacing_m)
