"""Ctrl-C and a request to end, put off while half of something would be left."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = signal.SIGINT, signal.SIGTERM


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals to end wait until the block does.

    Handlers are put off, not the signals blocked: another thread may receive what one blocks.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # handlers do not run here
        return
    came: list[int] = []
    before = {n: signal.signal(n, lambda number, frame: came.append(number)) for n in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
