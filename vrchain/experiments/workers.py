"""Work that is done number by number, shared out among processes."""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from tqdm.auto import tqdm

from vrchain.allocator import keep_freed_memory
from vrchain.errors import WorkerError
from vrchain.files import ENDING, uninterrupted

MOST = 4  # processes, if nobody says how many: each holds a scene
# For each of several processes that share the cores: more threads would wait for one another.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "LP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")

Found = TypeVar("Found")


def each(
    work: Callable[[int], Found], numbers: Sequence[int], jobs: int | None, what: str
) -> list[Found]:
    """What ``work`` finds of every number, in their order; one job does it in this process.

    jobs: by default as many as there are cores, at most four; one in a process that is itself one
    of these. Broken off, or when one fails, all are ended at once.
    """
    if parent_process() is not None:
        jobs = 1
    hidden = True if len(numbers) == 1 else None  # None: shown on a terminal
    jobs = min(jobs or min(os.cpu_count() or 1, MOST), len(numbers))
    if jobs <= 1:
        return [work(number) for number in tqdm(numbers, desc=what, unit="", disable=hidden)]
    # a new process each: what draws and learns must not be forked
    context = get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as scratch,
        ProcessPoolExecutor(
            jobs, mp_context=context, initializer=_alone_on_a_core, initargs=(scratch,)
        ) as pool,
    ):
        try:
            with uninterrupted(), _deaf():  # one half started would complain in many lines
                begun = [pool.submit(work, number) for number in numbers]
            for done in tqdm(
                as_completed(begun), desc=what, unit="", total=len(begun), disable=hidden
            ):
                done.result()
            return [done.result() for done in begun]
        except BrokenProcessPool:
            raise WorkerError(
                f"one of {jobs} processes was ended from outside, perhaps for want of memory; what "
                "was done is kept where results are: run it again, with --jobs 1"
            ) from None
        except BaseException:
            for process in active_children():
                process.terminate()
            raise


@contextmanager
def _deaf() -> Iterator[None]:
    """Signals are blocked, which processes that are started inherit, until they ignore them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _alone_on_a_core(scratch: str) -> None:
    """One thread, before libraries start theirs; the first process alone hears Ctrl-C.

    scratch: where temporary files go, which are left behind where a process is ended.
    """
    Thread(target=_end_with, args=(parent_process(),), daemon=True).start()
    tempfile.tempdir = scratch
    keep_freed_memory()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    os.environ.update(ONE_THREAD)


def _end_with(parent: Any) -> None:
    """Nobody works on for a process that was killed."""
    parent.join()
    os._exit(1)
