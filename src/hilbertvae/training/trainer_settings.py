"""How a network is trained: the keys `trainer.*`."""

from __future__ import annotations

from dataclasses import dataclass

from hilbertvae.checks import InputError, check_not_negative, check_positive
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path

ACCELERATORS = ("auto", "cpu", "gpu", "cuda", "mps")
OPTIMIZER_KINDS = ("muon", "adamw")
"""Those of the package; one of somebody's own is looked for among `OPTIMIZERS`."""
PRECISIONS = ("auto", "32-true", "bf16-mixed", "16-mixed")
MOST_THREADS = 1024


@dataclass
class TrainerSettings:
    """How a network is trained. One epoch is `steps_per_epoch` batches; checkpoints are written at its end."""

    epochs: int = 12
    steps_per_epoch: int = 250
    batch_size: int = 64
    initial: str | None = None
    """Start from the weights of this `model.safetensors`, or of a network that comes with the package (`2d`, `3d`), instead of fresh ones:
    of one of the same shape, or one with twice the stem, with fewer channels or blocks, that was shown labels alone, or without an output
    for what would be known."""
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
        if self.initial and not checkpoint_path(self.initial).is_file():
            known = f"a model.safetensors, or one of {', '.join(SHIPPED)}"
            raise InputError(f"trainer.initial: expected {known}, got {self.initial}, which is not there")
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
