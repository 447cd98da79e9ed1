import os
import signal
import threading

import pytest

from hilbertvae.signals import STOPS, not_stopped, stopped_by_signals


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
    with pytest.raises(KeyboardInterrupt), stopped_by_signals():
        with not_stopped():
            for _ in range(2):
                os.kill(os.getpid(), number)
                done.append("went on")
        done.append("too late")
    assert done == ["went on", "went on"]


def test_other_threads_have_no_signals():
    done = []

    def work():
        with stopped_by_signals(), not_stopped():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done
