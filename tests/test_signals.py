import itertools
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from hilbertvae.signals import STOPS, stopped_by_signals, to_its_end


@pytest.fixture(autouse=True)
def nothing_ignored():
    """A suite that was started by `nohup` ignores closed terminals itself, and one that a script started in the background Ctrl-C."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in STOPS}
    before[signal.SIGINT] = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", STOPS)
def test_what_asks_to_stop_ends_a_command_as_ctrl_c_does(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), stopped_by_signals():
        os.kill(os.getpid(), number)
        signal.pause()
    assert signal.getsignal(number) is before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="there are no terminals to be closed")
def test_what_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopped_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, *STOPS])
def test_what_must_not_be_cut_short_ends_first(number):
    done = []

    def work():
        for _ in range(2):
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            done.append("went on")

    with pytest.raises(KeyboardInterrupt), stopped_by_signals():
        to_its_end(work)
        done.append("too late")
    assert done == ["went on", "went on"]


def test_whatever_a_second_stop_raises_it_is_waited_for():
    """As a handler that ends the process does."""
    done = []

    def leave(number, frame):
        raise SystemExit(number)

    def work():
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.05)
        done.append("ended")

    signal.signal(signal.SIGTERM, leave)
    with pytest.raises(SystemExit):
        to_its_end(work)
    assert done == ["ended"]


def test_where_no_thread_can_be_started_the_work_is_done_all_the_same(monkeypatch):
    """As when the interpreter ends."""

    def none(*_):
        raise RuntimeError("can't create new thread at interpreter shutdown")

    monkeypatch.setattr("_thread.start_new_thread", none)
    assert to_its_end(lambda: 7) == 7


def test_what_runs_to_its_end_gives_what_it_returns_or_raises():
    assert to_its_end(lambda: 7) == 7
    for error in (ValueError("wrong"), SystemExit("killed"), KeyboardInterrupt()):

        def work(error=error):
            raise error

        with pytest.raises(type(error)) as raised:
            to_its_end(work)
        assert raised.value is error


def test_wherever_it_is_stopped_it_has_ended_or_not_begun():
    """An exception at each of the lines that the main thread runs, as a signal's handler may raise one."""
    seen = []
    for nth in itertools.count(1):
        steps, lines = [], []

        def work(steps=steps):
            steps.append("begun")
            time.sleep(0.005)
            steps.append("ended")

        def traced(frame, event, arg, lines=lines, nth=nth):
            if frame.f_code.co_filename.endswith(("signals.py", "threading.py")) and event == "line":
                lines.append(frame.f_lineno)
                if len(lines) == nth:
                    raise KeyboardInterrupt
            return traced

        before = sys.gettrace()
        sys.settrace(traced)
        try:
            to_its_end(work)
            stopped = False
        except KeyboardInterrupt:
            stopped = True
        finally:
            sys.settrace(before)
        came = list(steps)
        time.sleep(0.02)
        assert steps == came and came in ([], ["begun", "ended"])
        if not stopped:
            break
        seen.append(came)
    assert [] in seen and ["begun", "ended"] in seen


def test_handlers_of_c_stay(tmp_path):
    """As a robot's middleware has them: Python knows nothing of them."""
    program = """
import ctypes, signal
from hilbertvae.signals import to_its_end
libc = ctypes.CDLL(None)
libc.signal.restype, libc.signal.argtypes = ctypes.c_void_p, [ctypes.c_int, ctypes.c_void_p]
came = []
handler = ctypes.CFUNCTYPE(None, ctypes.c_int)(came.append)
for number in (signal.SIGINT, signal.SIGTERM):
    libc.signal(number, ctypes.cast(handler, ctypes.c_void_p))
to_its_end(lambda: None)
for number in (signal.SIGINT, signal.SIGTERM):
    libc.raise_(number) if hasattr(libc, "raise_") else libc["raise"](number)
print(*map(int, came))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == [str(int(signal.SIGINT)), str(int(signal.SIGTERM))], done.stderr


def test_other_threads_have_no_signals():
    done = []

    def work():
        with stopped_by_signals():
            to_its_end(lambda: done.append(threading.current_thread()))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [thread]
