import re

import pytest
from bag_scene import bag_file, read_or_refuse, write_scene
from bag_writers import KINDS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag

pytest.importorskip("rosbags")


def test_missing_foreign_and_truncated_files(tmp_path):
    for name in ("nowhere.bag", "nowhere.mcap", "nowhere.db3"):
        with pytest.raises(InputError, match=f"{name}: no such file; expected a ROS bag"):
            read_bag(tmp_path / name)
    for suffix in (".bag", ".mcap", ".db3"):
        for content in (b"", b"\x89PNG\r\n\x1a\n" + bytes(2000), b"\n", bytes(997)):
            path = tmp_path / f"foreign{suffix}"
            path.write_bytes(content)
            with pytest.raises(InputError, match=re.escape(str(path))):
                read_bag(path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "metadata.yaml").write_text("rosbag2_bagfile_information: [1")
    with pytest.raises(InputError, match="folder: can't be read as a ROS bag"):
        read_bag(tmp_path / "folder")
    for kind in KINDS:
        whole = bag_file(write_scene(tmp_path / KINDS[kind], kind, lasers=0))
        content = whole.read_bytes()
        for part in (0.02, 0.4, 0.97):
            whole.write_bytes(content[: int(part * len(content))])
            with pytest.raises(InputError, match=re.escape(str(tmp_path / KINDS[kind]))):
                read_bag(tmp_path / KINDS[kind])


values = st.sampled_from([0, 1, 255]) | st.integers(0, 255)
mutations = st.lists(st.tuples(st.floats(0, 0.9999), values), min_size=1, max_size=6)


@pytest.fixture(scope="module")
def sound_bags(tmp_path_factory):
    """Small bags by kind; a packed one, too, whose bytes mean more each."""
    folder = tmp_path_factory.mktemp("sound")
    made = {kind: write_scene(folder / name, kind, lasers=1, clouds=2) for kind, name in KINDS.items()}
    made["packed"] = write_scene(folder / "packed", "mcap", "ZSTD", lasers=1, clouds=2)
    contents = {kind: bag_file(path).read_bytes() for kind, path in made.items()}
    return lambda kind: (made[kind], contents[kind])  # a function, so that a failing example is not printed with all bytes


@pytest.mark.parametrize("kind", [*KINDS, "packed"])
@settings(max_examples=60, suppress_health_check=[HealthCheck.differing_executors])
@given(changes=mutations, cut=st.just(1.0) | st.floats(0, 1), ends=st.booleans())
def test_changed_bytes_raise_nothing_but_input_errors(sound_bags, kind, changes, cut, ends):
    path, content = sound_bags(kind)
    changed = bytearray(content)
    for place, value in changes:  # half of the time at the ends, where headers and indexes are
        far = int(place * len(content))
        changed[far if not ends else far % 600 if far % 2 else -1 - far % 1500] = value
    bag_file(path).write_bytes(changed[: round(cut * len(changed))])
    read_or_refuse(path)


@settings(max_examples=40, suppress_health_check=[HealthCheck.differing_executors])
@given(changes=mutations)
def test_changed_metadata_raises_nothing_but_input_errors(sound_bags, changes):
    path, content = sound_bags("sqlite")
    bag_file(path).write_bytes(content)
    metadata = path / "metadata.yaml"
    text = metadata.read_bytes()
    changed = bytearray(text)
    for place, value in changes:
        changed[int(place * len(text))] = value
    metadata.write_bytes(changed)
    try:
        read_or_refuse(path)
    finally:
        metadata.write_bytes(text)
