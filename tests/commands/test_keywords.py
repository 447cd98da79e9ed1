import os
import signal
import subprocess
import sys

import pytest

from hilbertvae.commands.keywords import stopped_by_sigterm


def test_sigterm_ends_a_command_as_ctrl_c_does():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), stopped_by_sigterm():
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_reader_that_has_had_enough_is_no_error():
    """As `hilbertvae-query ... | head -1`: more lines than a pipe holds."""
    code = """
import dataclasses, sys
from hilbertvae.commands.keywords import run_command

@dataclasses.dataclass
class Settings:
    lines: int = 100_000

sys.exit(run_command("say", Settings, "", lambda settings: print(*range(settings.lines), sep=chr(10), flush=True), ["lines=100000"]))
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"0\n"
        process.stdout.close()
        assert process.stderr.read() == b"" and process.wait() == 1
