import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NEEDED = [*PROJECT["dependencies"], *(one for extra in PROJECT["optional-dependencies"].values() for one in extra)]
REQUIRED = {needed.name: needed.specifier for needed in map(Requirement, NEEDED)}


@pytest.mark.parametrize(
    ("name", "too_old", "enough"),
    [
        ("numpy", "2.0.0", "2.0.1"),  # `np.unique` of rows gives its inverse two axes
        ("scipy", "1.14.1", "1.15.0"),  # `scipy.sparse.get_index_dtype`
        ("embreex", "2.17.7", "2.17.7.post5"),  # its module is `pyembree` there
        ("embreex", "2.17.7.post4", "2.17.7.post5"),  # built for numpy 1 on Python 3.11
        ("rosbags", "0.11.6", "0.11.7"),  # unpacks by `zstd.ZstdDecompressor` of Python 3.14 and its backport
        ("laspy", "2.6.0", "2.6.1"),  # can't be imported, and was withdrawn
    ],
)
def test_versions_that_lack_what_is_used_are_not_installed(name, too_old, enough):
    assert too_old not in REQUIRED[name] and enough in REQUIRED[name]


@pytest.mark.parametrize(("python", "wanted"), [("3.13", True), ("3.14", False)])
def test_poses_are_left_out_where_kiss_icp_has_no_wheels(python, wanted):
    """Else `make install`, which takes this extra too, would end there."""
    (needed,) = map(Requirement, PROJECT["optional-dependencies"]["poses"])
    assert needed.marker.evaluate({"python_version": python}) is wanted
