"""Numbers that docs/method.md has, by which code cites it, are those of the code and of the result files."""

import re
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir

from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.lard import NEAREST, STRETCH
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.reconstruction.shipped import SHIPPED
from hilbertvae.reports.result_json import read_result
from hilbertvae.scoring.cases import OCCLUSION_BANDS_M, OCCLUSION_RANGE_M
from hilbertvae.scoring.metrics import CALIBRATION_BINS, SMALLEST_PROBABILITY

ROOT = Path(__file__).parents[2]
METHOD = (ROOT / "docs/method.md").read_text(encoding="utf-8")


def test_every_section_of_the_method_that_code_cites_is_there():
    """Its page is what `METHOD n` in comments stands for."""
    there = set(re.findall(r"^## (\d)\. ", METHOD, re.MULTILINE))
    code = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("src/**/*.py"))
    cited = set("".join(re.findall(r"METHOD (\d(?: and \d)*)", code))) & set("0123456789")
    assert {"0", "7"} <= cited <= there


def test_how_sampling_changes_scores():
    """METHOD 1 has numbers of Intel's nearest neighbours, on points and on voxels."""
    said = re.search(r"has F1 (.*) in gaps and 15 of them a best F1 of (.*), on every voxel once (.*) and (.*)\. So", METHOD).groups()
    scores = read_result(ROOT / "docs/results/shipped/2d/result.json")[0].scores
    rows = [(reading, *row) for reading in ("points", "voxels") for row in (("nearest", "f1"), ("nearest-15", "best_f1"))]
    assert said == tuple(f"{np.mean(scores[mapper][reading]['gaps'][metric]):.2f}" for reading, mapper, metric in rows)


def test_the_method_has_the_frames_that_there_are():
    """METHOD 2 and 3: how far boxes stand apart, and which ones are turned."""
    grids = {name: load_mapper(name).reconstructor.grid for name in SHIPPED}
    apart = [2 * grid.inner_radius_m / grid.cluster_diameter_m for grid in grids.values()]
    assert f"ours from {min(apart):.3f} (2D) to {max(apart):.3f} (3D)" in METHOD
    turned = re.search(r"scale; (.*) and the experiments `real_2d` and `real_3d` turn their boxes", METHOD)[1]
    assert set(turned.split(", ")) == {f"`{name}`" for name, grid in grids.items() if grid.frame.rotation == "spread"}
    with initialize_config_dir(str(CONF), version_base="1.3"):
        for name in ("real_2d", "real_3d"):
            assert to_settings(compose("config", overrides=[f"experiment={name}"])).grid.frame.rotation == "spread"


def test_the_method_has_the_numbers_that_code_cites_it_for():
    """METHOD 4 and 6."""
    hm = FixedGridMapper()
    assert f"RBFs exp(-{hm.gamma_per_m2:g} r^2) on a fixed grid of {hm.spacing_m:g} m" in METHOD
    assert STRETCH == 5 and f"five times the covariance of its returns, the {NEAREST} nearest clusters" in METHOD
    with initialize_config_dir(str(CONF), version_base="1.3"):
        paper, example = (to_settings(compose("config", overrides=[f"network={name}"])).network for name in ("paper_64", "paper_32"))
    assert f"max-pool 2, dropout of {paper.dropout:g}," in METHOD and f"its example, with dropout of {example.dropout:g}." in METHOD


def test_the_method_has_the_numbers_of_scores():
    """METHOD 7."""
    least = f"{SMALLEST_PROBABILITY:.0e}".replace("e-0", "e-")
    assert f"NLL is of p between {least} and 1 - {least}; ECE has {CALIBRATION_BINS} equal bins of p" in METHOD


def test_the_method_has_the_bands_that_are_asked():
    """METHOD 7."""
    bands = f"{OCCLUSION_BANDS_M[0][0]:g} to {OCCLUSION_BANDS_M[-1][1]:g} m from the nearest kept point, in bands"
    assert f"{bands} (a row without one, as `occluded-sparse`, has those from {OCCLUSION_RANGE_M[0]:g} m on)" in METHOD
