"""An array in fewer bytes and back, to the bit: its bytes by significance, then deflate (RFC 1950)."""

from __future__ import annotations

import zlib

import numpy as np

from hilbertvae.checks import InputError

LEVEL = 1
"""Higher levels take several times as long for a few per cent."""


def pack(array: np.ndarray) -> np.ndarray:
    """(N,) uint8. Of the halves of float16 logits only the higher repeats itself, so that each is deflated by itself."""
    planes = np.ascontiguousarray(array).reshape(-1).view(np.uint8).reshape(-1, array.dtype.itemsize)
    return np.frombuffer(zlib.compress(np.ascontiguousarray(planes.T).data, LEVEL), dtype=np.uint8)


def unpack(packed: np.ndarray, kind: type[np.generic], shape: tuple[int, ...], name: str) -> np.ndarray:
    """The array of that kind and shape that `pack` was given. An `InputError` that names it for bytes that hold anything else; no more
    memory is taken than the shape needs, whatever they claim."""
    expected = f"{name}: expected {np.dtype(kind)} {shape}, packed"
    if packed.dtype != np.uint8 or packed.ndim != 1:
        raise InputError(f"{expected}, got {packed.dtype} {packed.shape}")
    size, width = int(np.prod(shape)), np.dtype(kind).itemsize
    stream = zlib.decompressobj()
    try:
        found = stream.decompress(np.ascontiguousarray(packed).data, size * width + 1)
    except zlib.error as error:
        raise InputError(f"{expected}, got bytes that are damaged ({error})") from error
    if len(found) != size * width or not stream.eof or stream.unused_data:
        raise InputError(f"{expected}, got bytes of another length")
    planes = np.frombuffer(found, dtype=np.uint8).reshape(width, size)
    return np.array(planes.T, order="C").view(kind).reshape(shape)  # a copy, that can be written
