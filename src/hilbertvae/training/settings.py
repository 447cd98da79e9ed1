"""All settings of a run: the Hydra schema, and the argument of `train`. Defaults stand here and in the parts named here, nowhere else."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, field
from typing import Any

from hilbertvae.checks import InputError, check_count, check_finite, check_positive, check_seeds
from hilbertvae.cloud import RESOLUTION_M
from hilbertvae.clusters.comparison import StudySettings
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.grids.training_grids import ClusteringSettings
from hilbertvae.mappers.weights import OCCUPIED_WEIGHT, check_occupied_weight
from hilbertvae.reconstruction.settings import AugmentationSettings, GatedNetworkSettings, LikelihoodSettings
from hilbertvae.reconstruction.symmetry import check_flips
from hilbertvae.reports.mapper_names import is_network
from hilbertvae.scoring.protocol_settings import Protocol, check_given
from hilbertvae.simulate.building import BuildingSettings
from hilbertvae.site import SIMULATED, SiteSource
from hilbertvae.training.data_settings import DataSettings
from hilbertvae.training.site_roles import check_roles
from hilbertvae.training.trainer_settings import TrainerSettings

TASKS = ("maps", "clustering")
TRAINED = "trained"
"""What a mapper's `reconstructor` is set to when it takes the network of the run; any other text is a checkpoint's path."""
COARSE = 0.6
"""Of a voxel: smaller cells are told of. A cloud has one point a voxel, so in the plane one in four of cells half as wide is known."""


@dataclass
class Settings:
    """One run of `hilbertvae-train`."""

    name: str = "run"
    task: str = "maps"
    """`maps`: train if need be, and score maps; `clustering`: compare ways to start a clustering (Fig. 2), without any map."""
    case: str = ""
    """Which row of a sweep's table this run is."""
    size: str = ""
    """Of the sweep that this run belongs to: `quick` or `full`."""
    output: str | None = None
    """Folder of all that the run writes; `outputs/<name>` unless given."""
    seed: int = 0
    dimension: int = 2
    resolution_m: float | None = None
    """The side of a voxel; 0.1 in 2D and 0.2 in 3D unless given."""
    data: DataSettings = field(default_factory=DataSettings)
    clustering: ClusteringSettings = field(default_factory=ClusteringSettings)
    grid: GridSettings = field(default_factory=GridSettings)
    augmentation: AugmentationSettings = field(default_factory=AugmentationSettings)
    network: Any = field(default_factory=GatedNetworkSettings)
    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    trainer: TrainerSettings = field(default_factory=TrainerSettings)
    evaluation: Protocol = field(default_factory=Protocol)
    validation_gap_m: float = 2.5
    """Diameter of the gaps on the validation site that the best weights are chosen with, and the Hilbert Map's are learned from."""
    calibration_seeds: list[int] = field(default_factory=lambda: [100, 101, 102, 103, 104])
    """Gap seeds on the validation site that the Hilbert Map's `rank` weights are learned from; not those that it is scored on."""
    calibration_given: str = "scans"
    """What maps are given where those weights are learned, as `evaluation.given` has it for scores: `scans`, `map` or `fine-map`."""
    calibration_occupied_weight: float = OCCUPIED_WEIGHT
    """How many points one that is occupied counts for, where those weights are learned on points; 1 is the paper's Eq. 15."""
    flips: int | None = None
    """Symmetries over which the network of the run is averaged, in learning the Hilbert Map's weights and in its maps: 1, 2, 4 or 8; 4 in
    2D and 1 in 3D unless given."""
    device: str = "auto"
    """Where networks fill maps, in learning the Hilbert Map's weights and in scoring: `cpu`, `cuda`, or `auto`, where the run would train
    (`trainer.accelerator`)."""
    study: StudySettings = field(default_factory=StudySettings)
    """Of the task `clustering`: what `grid.start` is tried on."""
    mapper: dict[str, Any] = field(default_factory=dict)
    """What is scored: by name, `_target_` and settings of an estimator."""
    scoring_processes: int = 1
    """Mappers that are scored at a time, each in a process that opens the site anew. Their times are then those of a busy machine."""
    pictures: bool = True
    checkpoint: str | None = None
    """Score this `model.safetensors`, or a network that comes with the package (`2d`, `3d`), instead of training."""
    trained: str | None = None
    """Folder where trained networks are kept under the hash of what made them, so that runs that differ in scoring alone train once."""

    def __post_init__(self):
        if self.output is None:
            self.output = f"outputs/{self.name}"
        if self.resolution_m is None:
            self.resolution_m = RESOLUTION_M.get(self.dimension)

    def source(self) -> SiteSource:
        """How the run's sites are read."""
        data = self.data
        building = BuildingSettings("any", *data.simulated_extent_m, data.simulated_scans, variety=data.simulated_variety)
        return SiteSource(self.dimension, data.folder, data.download, building, data.street, data.reading)

    def simulated_sites(self) -> list[str]:
        """References of the simulated sites that are trained on."""
        first = self.data.simulated_first
        return [f"{SIMULATED}{number}" for number in range(first, first + self.data.simulated)]

    def trains_none(self) -> bool:
        """Whether all networks that are scored were trained before: the `checkpoint`, or those that mappers name."""
        asked = [one.get("reconstructor") for one in self.mapper.values() if isinstance(one, dict)]
        return bool(self.checkpoint) or (TRAINED not in asked and any(asked))

    def calibration_sites(self) -> list[str]:
        """References of the sites that the Hilbert Map's weights are learned on."""
        return self.data.calibrate or [self.data.validate]

    def calibration(self) -> dict[str, Any]:
        """How `learn_rank_weights` is to learn."""
        return {
            "gap_diameter_m": self.validation_gap_m,
            "seeds": self.calibration_seeds,
            "occupied_weight": self.calibration_occupied_weight,
            "given": self.calibration_given,
        }

    def check(self) -> None:
        """An `InputError` that names the key for the first value that makes no run."""
        if self.dimension not in (2, 3):
            raise InputError(f"dimension: expected 2 or 3, got {self.dimension}")
        if not self.name.strip():  # its results would lie among the folders of all others
            raise InputError("name: expected a name for the run and its folder, got none")
        check_finite(asdict(self))
        check_positive(self.resolution_m, "resolution_m")
        if self.task not in TASKS:
            raise InputError(f"task: expected one of {', '.join(TASKS)}, got {self.task!r}")
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed: expected a whole number from 0 to {2**32 - 1}, got {self.seed}")
        self.grid.check()
        self.study.check()
        self.evaluation.check()
        self.data.check(self.dimension)
        self.trainer.check()
        if self.task == "clustering" and self.study.cloud == "returns" and not self.data.test:
            raise InputError("data.test: expected a site whose returns are clustered, got none")
        # Of networks that are given their cards say on what they were trained.
        trained = [] if self.trains_none() else [*self.data.train, *self.simulated_sites()]
        check_roles(trained, self.data.validate, self.data.test, self.data.calibrate)
        check_count(self.clustering.clusterings, "clustering.clusterings")
        for name, mapper in self.mapper.items():
            if isinstance(mapper, dict) and mapper.get("reconstructor") and not is_network(name):
                raise InputError(f"mapper.{name}: expected a name that begins with cvae-, by which tables know that it has a network")
        if not self.checkpoint and self.grid.frame.scale == "fixed" and self.grid.cell_m < COARSE * self.resolution_m:
            cells = f"cells of {self.grid.cell_m:g} m in voxels of {self.resolution_m:g} m, of which most stay unknown"
            warnings.warn(
                f"grid.cells: {cells}; `grid.cluster_diameter_m` / `grid.cells` is a cell's side", stacklevel=1
            )  # told once, whoever checks
        check_seeds(self.calibration_seeds, "calibration_seeds")
        check_positive(self.scoring_processes, "scoring_processes")
        check_positive(self.validation_gap_m, "validation_gap_m")
        check_given(self.calibration_given, "calibration_given")
        check_occupied_weight(self.calibration_occupied_weight, "calibration_occupied_weight")
        check_flips(self.flips)
        if self.device != "auto":
            from hilbertvae.reconstruction.precision import check_device  # late: torch

            check_device(self.device)
