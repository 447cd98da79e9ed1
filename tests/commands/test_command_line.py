"""The words of `hilbertvae-train` before Hydra reads them."""

import pytest
from warm_start import train

from hilbertvae.checks import InputError
from hilbertvae.commands.command_line import options_last, refuse_shadowed
from hilbertvae.commands.configuration import CONF


@pytest.mark.parametrize(("typed", "expected"), [
    ("", ""), ("debug=fast --config-dir own mapper=[hm] name=a", "debug=fast mapper=[hm] name=a --config-dir own"),
    ("a=1 -m b=2", "a=1 b=2 -m"), ("--cfg job a=1 -p trainer", "a=1 --cfg job -p trainer"), ("-cd -m a=1", "a=1 -cd -m"),
    ("a=1 --info defaults b=2", "a=1 b=2 --info defaults"), ("--info a=1", "a=1 --info"), ("--cfg=job ~x +y=2", "~x +y=2 --cfg=job"),
])  # fmt: skip
def test_options_come_last_with_their_values(typed, expected):
    assert " ".join(options_last(typed.split())) == expected


@pytest.mark.parametrize("words", [["seed=1", "--cfg", "job", "-p", "trainer"], ["--cfg", "job", "seed=1", "-p", "trainer"]])
def test_a_part_of_the_settings_is_shown(tmp_path, words):
    done = train(tmp_path, *words)
    assert done.returncode == 0 and "epochs:" in done.stdout and "mapper:" not in done.stdout


@pytest.mark.parametrize("cfg", [["--cfg", "job"], ["--cfg=job"], ["-c", "job"], ["-cjob"]])
def test_settings_of_a_sweep_are_those_of_one_job(tmp_path, cfg):
    done = train(tmp_path, "-m", *cfg, "+sweep=table1")
    assert done.returncode == 2 and "leave out -m" in done.stderr


def test_a_file_of_a_linked_folder_is_seen_too(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "own").mkdir()
    (tmp_path / "there/real_2d.yaml").write_text("name: shadow\n")
    (tmp_path / "own/experiment").symlink_to(tmp_path / "there")
    with pytest.raises(InputError, match="--config-dir: .*own/experiment/real_2d.yaml: hilbertvae has its own experiment/real_2d.yaml"):
        refuse_shadowed(["-cd", str(tmp_path / "own")])
    refuse_shadowed([])  # as `make run` has it
    refuse_shadowed([f"--config-dir={CONF}", "a=1"])  # the package's own folder
    refuse_shadowed(["--config-dir", str(tmp_path / "nowhere")])  # which Hydra tells


def test_a_mapper_may_extend_one_of_the_packages(tmp_path):
    (tmp_path / "mapper").mkdir()
    (tmp_path / "mapper/mine.yaml").write_text("# @package mapper\ndefaults: [hm]\nhm: {spacing_m: 1.0}\n")
    words = ["--config-dir", str(tmp_path), "debug=fast", "pictures=false", "evaluation.occlusion=false"]
    assert train(tmp_path, *words, "mapper=[mine,nearest]").returncode == 0
    both = train(tmp_path, *words, "mapper=[mine,hm-3d]", "name=both")
    assert both.returncode == 2 and "got mine and hm-3d, both called hm" in both.stderr
