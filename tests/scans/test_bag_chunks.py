import bz2
import re
from pathlib import Path

import numpy as np
import pytest
from bag_scene import write_scene
from bag_writers import KINDS, bag
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.scans import bag_chunks
from hilbertvae.scans.bags import read_bag

rosbag2 = pytest.importorskip("rosbags.rosbag2")
lz4 = pytest.importorskip("lz4.frame")
from rosbags.rosbag1 import reader as ros1_reader  # noqa: E402
from rosbags.rosbag2 import reader, storage_mcap  # noqa: E402

PACKERS = {
    "bz2": (bz2.compress, bz2.BZ2Decompressor),
    "lz4": (lz4.compress, lz4.LZ4FrameDecompressor),
    "zstd": (reader.zstd.compress, reader.zstd.ZstdDecompressor),
}
PACKED = pytest.mark.parametrize(("kind", "compression"), [("ros1", "BZ2"), ("ros1", "LZ4"), ("sqlite", "ZSTD"), ("mcap", "ZSTD")])


@pytest.mark.parametrize("packer", PACKERS)
@settings(max_examples=30)
@given(parts=st.lists(st.binary(max_size=300), min_size=1, max_size=4))
def test_streams_are_unpacked_one_after_the_other(packer, parts):
    pack, make = PACKERS[packer]
    assert bag_chunks.unpacked(make, b"".join(map(pack, parts))) == b"".join(parts)


@pytest.mark.parametrize("packer", PACKERS)
def test_no_stream_grows_beyond_the_limit(packer, monkeypatch):
    pack, make = PACKERS[packer]
    monkeypatch.setattr(bag_chunks, "SMALL_BYTES", 50_000)
    monkeypatch.setattr(bag_chunks, "MAX_EXPANSION", 10)
    for parts in ([50_001], [30_000, 30_000]):
        packed = b"".join(pack(bytes(size)) for size in parts)
        with pytest.raises(InputError, match=f"forged: {len(packed)} packed bytes grow beyond 50000"):
            bag_chunks.unpacked(make, packed)
    assert bag_chunks.unpacked(make, pack(bytes(50_000))) == bytes(50_000)
    noise = np.random.default_rng(0).bytes(100_000)
    assert bag_chunks.unpacked(make, pack(noise)) == noise
    with pytest.raises(InputError, match="truncated: 9 packed bytes end too early"):
        bag_chunks.unpacked(make, pack(noise)[:9])


def bomb(path, kind, compression):
    """A bag that a cloud of a million zeros makes grow a thousandfold."""
    with bag(path, kind, compression) as made:
        made.cloud("/points", 0, "lidar", np.zeros((100_000, 3)))
    return path


@PACKED
def test_bags_that_grow_are_refused(tmp_path, monkeypatch, kind, compression):
    monkeypatch.setattr(bag_chunks, "SMALL_BYTES", 1000)
    path = bomb(tmp_path / KINDS[kind], kind, compression)
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: forged: \d+ packed bytes grow beyond \d+$"):
        read_bag(path)


def packed_file_bag(path):
    """A ROS 2 bag whose file as a whole is packed."""
    write_scene(path, "sqlite", lasers=0)
    file = next(path.glob("*.db3"))
    packed = Path(f"{file}.zstd")
    packed.write_bytes(reader.zstd.compress(file.read_bytes()))
    file.unlink()
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    text = text.replace("compression_format: ''", "compression_format: zstd").replace("compression_mode: ''", "compression_mode: file")
    metadata.write_text(text.replace(file.name, packed.name))
    return path


def test_a_bag_packed_as_one_file(tmp_path, monkeypatch):
    plain = read_bag(write_scene(tmp_path / "plain", "sqlite", lasers=0))
    path = packed_file_bag(tmp_path / "packed")
    np.testing.assert_array_equal(read_bag(path).points, plain.points)
    monkeypatch.setattr(bag_chunks, "SMALL_BYTES", 1000)
    monkeypatch.setattr(bag_chunks, "MAX_EXPANSION", 2)
    with pytest.raises(InputError, match=r"packed: forged: \d+ packed bytes grow beyond \d+"):
        read_bag(path)


def test_rosbags_is_as_before_afterwards(tmp_path):
    before = dict(ros1_reader.decompressors), dict(storage_mcap.DECOMPRESSORS), reader.zstd
    with pytest.raises(ZeroDivisionError), bag_chunks.bounded_unpacking(tmp_path):
        assert storage_mcap.DECOMPRESSORS["zstd"] is not before[1]["zstd"]
        assert reader.zstd is not before[2]
        raise ZeroDivisionError
    assert (dict(ros1_reader.decompressors), dict(storage_mcap.DECOMPRESSORS), reader.zstd) == before
