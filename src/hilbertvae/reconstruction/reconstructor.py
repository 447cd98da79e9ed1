"""Grids in, reconstructed grids out: a trained network with all that is needed to use it, and its file."""

from __future__ import annotations

import copy
import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from hilbertvae.checks import InputError, check_cell_m, check_finite, check_readable
from hilbertvae.cloud import READINGS
from hilbertvae.files import atomic
from hilbertvae.grids.cluster_grids import GridSettings, labels_of
from hilbertvae.reconstruction.blocks import is_detailed
from hilbertvae.reconstruction.completion import Completion
from hilbertvae.reconstruction.conditional_network import ConditionalNetwork
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.networks import NETWORKS, NetworkSettings, build_network, network_settings
from hilbertvae.reconstruction.packed_weights import pack, unpack
from hilbertvae.reconstruction.precision import fast_autocast
from hilbertvae.reconstruction.settings import LikelihoodSettings
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path
from hilbertvae.reconstruction.symmetry import apply, apply_channels, check_flips, symmetries, undo

FORMAT = "hilbertvae-reconstructor-1"
LARGEST = float(np.finfo(np.float16).max)
"""Of a kernel value: in these numbers maps keep them."""


@dataclass(repr=False)
class Reconstructor:
    """A network, the likelihood it was trained with, and the grids it was trained on.

    `map_weights` holds the Hilbert Map's learned weights by reading (`points`, `voxels`), `card` what it was trained on; both are plain.
    `seconds` says how long its training took, stage by stage; it is no part of the file, which says nothing of the machine.
    """

    network: nn.Module
    network_settings: NetworkSettings
    likelihood: LikelihoodSettings
    grid: GridSettings
    dimension: int
    resolution_m: float
    map_weights: dict = field(default_factory=dict)
    card: dict = field(default_factory=dict)
    seconds: dict = field(default_factory=dict)

    def __repr__(self) -> str:
        """In a line, since every mapper's own `repr` has it."""
        return f"Reconstructor({self.network_settings.kind}, {self.dimension}D, {self.grid.cells} cells of {self.grid.cell_m:g} m)"

    def __getstate__(self) -> dict:
        """With a network that lies on the CPU, whatever computed last, so that a pickled map can be read where there is no GPU."""
        on_cpu = all(part.device.type == "cpu" for part in self.network.parameters())
        return {**self.__dict__, **({} if on_cpu else {"network": copy.deepcopy(self.network).cpu()})}

    @property
    def detailed(self) -> bool:
        """Whether the network is shown grids as `bin_detailed` makes them, and not labels alone."""
        return is_detailed(self.network_settings)

    def complete(
        self,
        grids: np.ndarray,
        flips: int = 4,
        batch: int = 64,
        device: str = "cpu",
        progress: Callable[[int, int], None] | None = None,
    ) -> Completion:
        """What the network makes of int8 `grids`, as `bin_shown` makes them: the mean over `flips` symmetries (1, 2, 4 or 8).

        `progress` is called after each batch with how many grids are done, and how many there are.
        """
        network = self.network.eval().to(device)
        kernel_value = LIKELIHOODS[self.likelihood.kind].kernel_value
        check_flips(flips)
        chosen = symmetries()[:flips]
        labels, move = labels_of(grids, self.dimension), apply_channels if self.detailed else apply
        value = np.empty(labels.shape, np.float16)
        known = np.empty(labels.shape, np.uint8) if getattr(self.network_settings, "known", False) else None
        with torch.inference_mode(), fast_autocast(device):
            for start in range(0, len(grids), batch):
                portion = slice(start, start + batch)
                shown = torch.from_numpy(grids[portion]).to(device)
                found = [(s, network(move(shown, s).contiguous())) for s in chosen]
                mean = sum(undo(kernel_value(given.output), s) for s, given in found) / flips
                if not mean.abs().max() <= LARGEST:  # a map's weights would be learned of them, and say nothing of it
                    kind = f"likelihood.kind={self.likelihood.kind}"
                    raise InputError(f"{kind}: expected finite kernel values of at most {LARGEST:g}, got {mean.abs().max().item():g}")
                value[portion] = mean.cpu().numpy()
                if known is not None:
                    share = sum(undo(torch.sigmoid(given.known.float()), s) for s, given in found) / flips
                    seen = labels_of(shown, self.dimension) != 0
                    known[portion] = torch.where(seen, 255, torch.round(255 * share)).to(torch.uint8).cpu().numpy()
                if progress:
                    progress(min(start + batch, len(grids)), len(grids))
        return Completion(value, known)

    def check_cells(self, cells: int) -> None:
        """An `InputError` for grids of so many cells along an axis, where the network can't complete them."""
        with torch.device("meta"), torch.random.fork_rng(devices=[]):  # shapes alone, and random numbers stay the caller's
            wanted = build_network(self.network_settings, self.dimension, cells).state_dict()
        if any(wanted[name].shape != tensor.shape for name, tensor in self.network.state_dict().items()):
            raise InputError(f"grid.cells: expected {self.grid.cells}, as the network has learned it, got {cells}")

    def reconstruct(self, grids: np.ndarray, flips: int = 4) -> np.ndarray:
        """float32 kernel values (M, n, ..., n): those of `complete`, alone."""
        return self.complete(grids, flips).value.astype(np.float32)

    def draws(self, grids: np.ndarray, count: int, seed: int = 0) -> np.ndarray | None:
        """float32 kernel values (count, M, n, ..., n): so many ways in which each of the grids may go on; None from a network that has
        no conditional prior to draw them from."""
        if not isinstance(self.network, ConditionalNetwork):
            return None
        network, generator = self.network.eval().cpu(), torch.Generator().manual_seed(seed)
        kernel_value = LIKELIHOODS[self.likelihood.kind].kernel_value
        with torch.inference_mode(), fast_autocast():
            return torch.stack([kernel_value(network.draw(torch.from_numpy(grids), generator)) for _ in range(count)]).numpy()

    def fingerprint(self) -> str:
        """The sha256, in hex, of all that a completion depends on; how the weights were stored is no part of it."""
        made_of = [asdict(self.network_settings), asdict(self.likelihood), self.grid.cells, self.dimension]
        digest = hashlib.sha256(json.dumps(made_of, sort_keys=True).encode())
        for name, tensor in sorted(self.network.state_dict().items()):
            digest.update(f"{name} {tuple(tensor.shape)} {tensor.dtype}".encode())
            digest.update(tensor.detach().cpu().contiguous().flatten().view(torch.uint8).numpy())
        return digest.hexdigest()

    def save(self, path: str | os.PathLike, packed: bool = False) -> Path:
        """One safetensors file with the weights, `packed` at a quarter of their size, and everything else as JSON in its header."""
        described = {
            "network": asdict(self.network_settings),
            "likelihood": asdict(self.likelihood),
            "grid": asdict(self.grid),
            "dimension": self.dimension,
            "resolution_m": self.resolution_m,
            "weights": self.map_weights,
            "card": self.card,
        }
        tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in self.network.state_dict().items()}
        with atomic(path) as temporary:
            try:
                save_file(
                    pack(tensors) if packed else tensors,
                    temporary,
                    metadata={"format": FORMAT, "settings": json.dumps(described, sort_keys=True)},
                )
            except SafetensorError as error:  # a full disk, for instance
                raise OSError(str(error)) from error  # which `atomic` names the file of
        return Path(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Reconstructor:
        """The reconstructor saved at `path`, or shipped under that name; an `InputError` for a missing, damaged or foreign file."""
        path = checkpoint_path(path)
        if not path.is_file():
            raise InputError(f"{path}: no such checkpoint; expected a model.safetensors, or one of {', '.join(SHIPPED)}")
        check_readable(path)
        try:
            with safe_open(path, framework="pt") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
        except (SafetensorError, OSError, ValueError) as error:
            raise InputError(f"{path}: not a checkpoint of hilbertvae, or damaged ({error}); expected a .safetensors file") from error
        if metadata.get("format") != FORMAT:
            raise InputError(f"{path}: {_another(str(metadata.get('format')))}")
        try:
            described = json.loads(metadata["settings"])
            _check_registered(described)
            settings = network_settings(described["network"])
            grid = GridSettings.from_plain(described["grid"])
            likelihood = LikelihoodSettings(**described["likelihood"])
            with torch.random.fork_rng(devices=[]):  # as the first weights are drawn, which are not kept
                network = build_network(settings, described["dimension"], grid.cells)
            network.load_state_dict(unpack(tensors))
            _check_kept(network, described)
            return cls(
                network=network,
                network_settings=settings,
                likelihood=likelihood,
                grid=grid,
                dimension=described["dimension"],
                resolution_m=described["resolution_m"],
                map_weights=described["weights"],
                card=described["card"],
            )
        except _Unregistered as error:
            raise InputError(f"{path}: {error}") from error
        except (KeyError, TypeError, AttributeError, RuntimeError, ValueError, OverflowError) as error:
            raise InputError(f"{path}: the checkpoint's settings and weights don't fit together ({error})") from error


def _another(found: str) -> str:
    if found.startswith("hilbertvae-reconstructor-"):
        return f"a network of another version ({found[:40]}), expected {FORMAT}"
    if found.startswith("hilbertvae-map-"):
        return "a map, which load_map reads; expected a network, as model.safetensors of a training is"
    return f"a safetensors file, but not a checkpoint of hilbertvae (format {found[:40]!r}, expected {FORMAT!r})"


class _Unregistered(Exception):
    """A whole file, of a kind that the code which reads it has not been told of."""


def _check_registered(described: dict) -> None:
    for what, table, known in (("network", "NETWORKS", NETWORKS), ("likelihood", "LIKELIHOODS", LIKELIHOODS)):
        kind = described[what].get("kind")
        if isinstance(kind, str) and kind not in known:
            here = f"there are {', '.join(known)} here"
            raise _Unregistered(f"a {what} of kind {kind!r}, and {here}; import what puts one of your own into {table} first")


def _check_kept(network: nn.Module, described: dict) -> None:
    """An `InputError` that names what in a file can be no network's or no map's: it would answer with NaN, or fail when a map is made."""
    for name, tensor in network.state_dict().items():
        if not torch.isfinite(tensor).all():
            raise InputError(f"{name}: expected finite weights, got NaN or inf")
    check_cell_m(described["resolution_m"], "resolution_m")
    for key in ("weights", "card"):
        if not isinstance(described[key], dict):
            raise InputError(f"{key}: expected an object, got {described[key]!r:.60}")
        check_finite(described[key], key)
    for calibration, learned in described["weights"].items():
        if calibration not in READINGS:
            raise InputError(f"weights: expected those of {' and '.join(READINGS)}, got {calibration!r:.60}")
        if not isinstance(learned, dict) or not all(map(_is_of_numbers, learned.values())):
            raise InputError(f"weights.{calibration}: expected numbers and flat lists of them, got {learned!r:.60}")


def _is_of_numbers(value: object) -> bool:
    return all(isinstance(one, (int, float)) for one in (value if isinstance(value, list) else [value]))
