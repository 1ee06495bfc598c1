"""Ctrl-C that comes while half of something would be left."""

import signal
import threading
import time

import pytest

from vrchain.interrupts import uninterrupted


def test_a_signal_that_another_thread_receives_waits_too() -> None:
    """As those of linear algebra do; Python's handlers run in the main thread all the same."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    ended, done = threading.Event(), []
    other = threading.Thread(target=ended.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt), uninterrupted():
            signal.pthread_kill(other.ident or 0, signal.SIGINT)
            done += [time.sleep(0.01) for _ in range(20)]
        assert len(done) == 20
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
        ended.set()
        other.join()
