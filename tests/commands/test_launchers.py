"""Jobs of a sweep in workers of a launcher, and in several processes that train one network."""

import pytest
from small_sweep import by_itself

from hilbertvae.reports.result_json import read_result

pytest.importorskip("embreex")


@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_launchers_run_the_jobs(launcher, tmp_path):
    pytest.importorskip({"joblib": "hydra_plugins.hydra_joblib_launcher", "submitit_local": "submitit"}[launcher])
    done = by_itself(tmp_path, "cases/ablation=default,weights-unit", f"launcher={launcher}")
    assert done.returncode == 0, done.stderr
    for case in ("default", "weights-unit"):
        result, _ = read_result(tmp_path / f"outputs/debug/ablation-quick/{case}-seed0/result.json")
        assert not result.failed
    assert len(list((tmp_path / "outputs/trained").glob("*.safetensors"))) == 1
    again = by_itself(tmp_path, "cases/ablation=default,weights-unit", f"launcher={launcher}")
    assert again.returncode == 0 and "2 of 2 jobs have results" in again.stdout


def test_two_processes_train_one_network(tmp_path):
    """In each job of a sweep, also in a launcher's worker; the second process takes part in its own job alone, else it would wait in the
    next one for ever."""
    jobs = ["launcher=joblib", "hydra.launcher.n_jobs=1", "cases/ablation=default,unmasked,weights-unit"]
    done = by_itself(tmp_path, *jobs, "trainer=ddp", "trainer.accelerator=cpu")
    assert done.returncode == 0, done.stderr
    for case in ("default", "unmasked"):
        folder = tmp_path / f"outputs/debug/ablation-quick/{case}-seed0"
        result, about = read_result(folder / "result.json")
        assert not result.failed and about["config"]["trainer"]["devices"] == 2
        assert sorted(path.name for path in (folder / "checkpoints").iterdir()) == ["best.ckpt", "last.ckpt"]
    assert read_result(tmp_path / "outputs/debug/ablation-quick/weights-unit-seed0/result.json")[0].scores
    assert not (tmp_path / "outputs/debug/ablation-quick/result.json").exists()
