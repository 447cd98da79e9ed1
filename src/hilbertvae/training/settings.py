"""All settings of a run: the Hydra schema, and the argument of `train`. Defaults stand here and in the parts named here, nowhere else."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hilbertvae.checks import InputError, check_count, check_finite, check_not_negative, check_positive, check_seeds
from hilbertvae.cloud import RESOLUTION_M
from hilbertvae.clusters.comparison import StudySettings
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.grids.training_grids import ClusteringSettings
from hilbertvae.mappers.weights import OCCUPIED_WEIGHT, check_occupied_weight
from hilbertvae.reconstruction.settings import AugmentationSettings, GatedNetworkSettings, LikelihoodSettings
from hilbertvae.reconstruction.symmetry import check_flips
from hilbertvae.scans.formats import ReadingSettings
from hilbertvae.scoring.protocol_settings import Protocol, check_given
from hilbertvae.simulate.building import MOST_EXTENT_M, BuildingSettings
from hilbertvae.simulate.building_variety import check_variety
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import SIMULATED, SiteSource
from hilbertvae.training.site_roles import check_roles

TASKS = ("maps", "clustering")
TRAINED = "trained"
"""What a mapper's `reconstructor` is set to when it takes the network of the run; any other text is a checkpoint's path."""
ACCELERATORS = ("auto", "cpu", "gpu", "cuda", "mps")
OPTIMIZER_KINDS = ("muon", "adamw")
"""Those of the package; one of somebody's own is looked for among `OPTIMIZERS`."""
PRECISIONS = ("auto", "32-true", "bf16-mixed", "16-mixed")
MOST_THREADS = 1024


@dataclass
class DataSettings:
    """Which sites play which part: a name of the catalogue, `simulated:<seed>` (a building, in 3D a street), or a path."""

    train: list[str] = field(default_factory=list)
    validate: str = "simulated:900001"
    calibrate: list[str] = field(default_factory=list)
    """What the Hilbert Map's weights are learned on, if not on the site of `validate`: one building's need not be another's."""
    test: list[str] = field(default_factory=lambda: ["simulated:900002"])
    simulated: int = 0
    """Simulated buildings, in 3D streets, to train on, beside the sites of `train`."""
    simulated_first: int = 0
    """Seed of the first of them, those of the others follow: a training that goes on may see others than the one before."""
    simulated_clusterings: int = 2
    """Times each simulated site is clustered; real sites take `clustering.clusterings`."""
    simulated_scans: int = 700
    """At most so many sweeps in a simulated building."""
    simulated_extent_m: list[float] = field(default_factory=lambda: [30.0, 95.0])
    """Range of a simulated building's length."""
    simulated_variety: str = "usual"
    """How much simulated buildings differ: `usual`, or `wide`: smaller ones and other lasers, too. `data.street` has a key of its own."""
    street: StreetSettings = field(default_factory=StreetSettings)
    reading: ReadingSettings = field(default_factory=ReadingSettings)
    """How paths are read; the sites of the catalogue are read as it says."""
    folder: str | None = None
    """Where real sites lie; by default `HILBERTVAE_DATA`, else ../shared/data, else the user's cache folder."""
    download: bool = False
    """Fetch real sites that are not there."""
    cache: str = "outputs/cache"
    """Where training grids are kept, under the hash of what made them."""
    processes: int = 0
    """How many cluster sites at a time; 0: one per core."""

    def check(self) -> None:
        """An `InputError` that names the key for sites that can't be trained on."""
        if not self.train and not self.simulated:
            raise InputError("data.train: expected at least one site, or data.simulated buildings, got neither")
        for key in ("simulated", "simulated_first", "processes"):
            check_not_negative(getattr(self, key), f"data.{key}")
        check_count(self.simulated_scans, "data.simulated_scans")
        if self.simulated:
            check_count(self.simulated_clusterings, "data.simulated_clusterings")
        check_variety(self.simulated_variety, "data.simulated_variety")
        if len(extent := self.simulated_extent_m) != 2 or not 6 <= extent[0] <= extent[1] <= MOST_EXTENT_M:
            raise InputError(f"data.simulated_extent_m: expected two lengths from 6 to {MOST_EXTENT_M:g}, the shorter first, got {extent}")


@dataclass
class TrainerSettings:
    """How a network is trained. One epoch is `steps_per_epoch` batches; checkpoints are written at its end."""

    epochs: int = 12
    steps_per_epoch: int = 250
    batch_size: int = 64
    initial: str | None = None
    """Start from the weights of this `model.safetensors` instead of fresh ones: of a network of the same shape, or of one with twice the
    stem, one with fewer channels or blocks, one that was shown labels alone, or one without an output for what would be known."""
    optimizer: str = "muon"
    """`muon`, for convolutions, with AdamW for the rest; or `adamw` alone, which had half of Muon's rate when it was the default."""
    learning_rate: float = 4e-3
    weight_decay: float = 0.02
    warmup_share: float = 0.02
    """Share of all steps over which the learning rate rises. All the while it falls as a cosine over all steps, to a hundredth."""
    kl_weight: float = 1.0
    kl_warmup_share: float = 0.2
    free_nats: float = 0.05
    """KL per latent dimension that costs nothing."""
    gradient_clip: float = 1000.0
    patience_epochs: int = 0
    """Epochs without a better validation loss after which training ends; 0 trains to the end. The best weights are kept either way."""
    validation_grids: int = 1024
    precision: str = "auto"
    """As Lightning names them; auto is bf16-mixed where the processor multiplies in bfloat16, else 32-true."""
    threads: int = 0
    """Threads of torch; 0 leaves its own choice. Bits depend on it."""
    accelerator: str = "auto"
    devices: int = 1
    """Processes that train together; each draws batches of its own, so that numbers depend on it."""
    strategy: str = "auto"
    """Lightning's word for how they do: `ddp`."""

    def check(self) -> None:
        """An `InputError` that names the key for a value that trains nothing."""
        optimizers = OPTIMIZER_KINDS
        if self.optimizer not in optimizers:
            from hilbertvae.training.optimizers import OPTIMIZERS as optimizers  # late: torch

        for key, known in (("accelerator", ACCELERATORS), ("precision", PRECISIONS), ("optimizer", optimizers)):
            if (value := getattr(self, key)) not in known:
                raise InputError(f"trainer.{key}: expected one of {', '.join(known)}, got {value!r}")
        if self.initial and not Path(self.initial).is_file():
            raise InputError(f"trainer.initial: expected a model.safetensors, got {self.initial}, which is not there")
        for key in ("epochs", "steps_per_epoch", "batch_size", "learning_rate", "validation_grids", "devices"):
            check_positive(getattr(self, key), f"trainer.{key}")
        for key in ("weight_decay", "kl_weight", "free_nats", "gradient_clip", "patience_epochs", "threads"):
            check_not_negative(getattr(self, key), f"trainer.{key}")
        if self.threads > MOST_THREADS:
            raise InputError(f"trainer.threads: expected at most {MOST_THREADS}, got {self.threads}")
        if not 0 <= self.warmup_share < 1:
            raise InputError(f"trainer.warmup_share: expected a share in [0, 1), got {self.warmup_share}")
        if not 0.2 <= self.kl_warmup_share <= 1:
            raise InputError(f"trainer.kl_warmup_share: expected a share from 0.2 to 1, got {self.kl_warmup_share}")


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
        check_finite(asdict(self))
        check_positive(self.resolution_m, "resolution_m")
        if self.task not in TASKS:
            raise InputError(f"task: expected one of {', '.join(TASKS)}, got {self.task!r}")
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed: expected a whole number from 0 to {2**32 - 1}, got {self.seed}")
        self.grid.check()
        self.study.check()
        self.evaluation.check()
        self.data.check()
        self.trainer.check()
        if self.task == "clustering" and self.study.cloud == "returns" and not self.data.test:
            raise InputError("data.test: expected a site whose returns are clustered, got none")
        trained = [] if self.checkpoint else [*self.data.train, *self.simulated_sites()]  # of a network that is given its card says on what
        check_roles(trained, self.data.validate, self.data.test, self.data.calibrate)
        if self.data.train:
            check_count(self.clustering.clusterings, "clustering.clusterings")
        check_seeds(self.calibration_seeds, "calibration_seeds")
        check_positive(self.scoring_processes, "scoring_processes")
        check_positive(self.validation_gap_m, "validation_gap_m")
        check_given(self.calibration_given, "calibration_given")
        check_occupied_weight(self.calibration_occupied_weight, "calibration_occupied_weight")
        check_flips(self.flips)
        if self.device != "auto":
            from hilbertvae.reconstruction.precision import check_device  # late: torch

            check_device(self.device)
