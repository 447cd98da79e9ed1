import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.skipif(os.name == "nt" or not shutil.which("make"), reason="there is no make")
def test_an_older_python_is_refused_before_anything_is_set_up(tmp_path):
    """One that says that it is 3.10, whatever it is asked."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    old = tmp_path / "old"
    old.write_text(f"""#!/bin/sh
[ "$1" = -c ] || {{ touch '{tmp_path}/begun'; exit 1; }}
exec python3 -c "import sys; sys.version_info = (3, 10, 12); $2"
""")
    old.chmod(0o755)
    done = subprocess.run(["make", f"PYTHON={old}", "install"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode and "needs Python 3.11 or newer, and this is 3.10" in done.stderr
    assert not (tmp_path / "begun").exists() and not (tmp_path / ".venv").exists()
