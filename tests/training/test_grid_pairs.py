import os
import resource
from pathlib import Path

import numpy as np

from hilbertvae.training.grid_pairs import GridPairs


def test_batches_are_read_from_files_in_any_order(tmp_path):
    """Against all of it in memory: files of several lengths, one of them empty, and each kind of grid."""
    rng = np.random.default_rng(0)
    for channels, voted in ((2, False), (3, True), (7, False), (8, True)):
        files = [rng.integers(-9, 9, (count, channels, 4, 4), np.int8) for count in (3, 0, 1, 5)]
        paths = [tmp_path / f"{channels}-{number}.npy" for number in range(len(files))]
        for path, file in zip(paths, files, strict=True):
            np.save(path, file)
        pairs, every = GridPairs(paths, voted), np.concatenate(files)
        assert len(pairs) == 9
        for chosen in ([3, 0, 8, 3], [2], list(range(9))):
            shown, target = (part.numpy() for part in pairs[chosen])
            own = 1 + voted
            expected = every[chosen, :-own], every[chosen, -own:]
            for found, part in zip((shown, target), expected, strict=True):
                np.testing.assert_array_equal(found, part[:, 0] if part.shape[1] == 1 else part)


def test_more_sites_than_a_process_may_hold_files_open(tmp_path):
    """Many Linux systems allow 1024, and `2d` was trained on 1144."""
    open_now = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else 64
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    paths = [tmp_path / f"{number}.npy" for number in range(60)]
    for number, path in enumerate(paths):
        np.save(path, np.full((1, 2, 4, 4), number, np.int8))
    resource.setrlimit(resource.RLIMIT_NOFILE, (open_now + 30, hard))
    try:
        pairs = GridPairs(paths, voted=False)
        pairs.announce(list(range(60)))
        shown, _ = pairs[list(range(len(pairs)))]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    np.testing.assert_array_equal(shown[:, 0, 0], np.arange(60))
