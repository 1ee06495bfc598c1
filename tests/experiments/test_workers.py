"""Work shared out among processes: all is done, and nothing goes on after a failure."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import pytest
from worlds import ROOT

from vrchain.errors import MissionError, WorkerError
from vrchain.experiments.workers import each


def write(folder: Path, number: int) -> int:
    (folder / str(number)).write_text(str(os.getpid()))
    return number


def fail(folder: Path, number: int) -> None:
    if number == 1:
        raise MissionError("the second cannot be done")
    write(folder, number)
    time.sleep(0 if number == 0 else 100)


def leave(folder: Path, number: int) -> None:
    (folder / str(number)).write_text(tempfile.mkdtemp())
    fail(folder / "done", number)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_number_is_worked_on_once(jobs: int, tmp_path: Path) -> None:
    assert each(partial(write, tmp_path), range(6), jobs, "numbers") == list(range(6))
    by = {int(file.name): int(file.read_text()) for file in tmp_path.iterdir()}
    assert sorted(by) == list(range(6))
    assert set(by.values()) == {os.getpid()} if jobs == 1 else os.getpid() not in by.values()


@pytest.mark.parametrize("jobs", [1, 2])
def test_nothing_to_do(jobs: int, tmp_path: Path) -> None:
    each(partial(write, tmp_path), [], jobs, "numbers")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failure_is_told_and_ends_all(jobs: int, tmp_path: Path) -> None:
    begun_s = time.monotonic()
    with pytest.raises(MissionError, match="the second cannot be done"):
        each(partial(fail, tmp_path), range(6), jobs, "numbers")
    assert time.monotonic() - begun_s < 90  # nobody sleeps on
    assert len(list(tmp_path.iterdir())) < 5


def die(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_process_that_is_killed_is_told_in_a_line() -> None:
    with pytest.raises(WorkerError, match=r"ended from outside.*--jobs 1"):
        each(die, range(2), 2, "numbers")


def test_nothing_temporary_is_left_of_what_was_broken_off(tmp_path: Path) -> None:
    (tmp_path / "done").mkdir()
    with pytest.raises(MissionError):
        each(partial(leave, tmp_path), range(6), 2, "numbers")
    told = [file.read_text() for file in tmp_path.glob("[0-9]")]  # one may have been cut short
    assert any(told) and not any(Path(folder).exists() for folder in told if folder)


@pytest.mark.parametrize(
    "how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=["Ctrl-C", "ended", "killed"]
)
def test_whatever_ends_it_ends_all(how: signal.Signals, tmp_path: Path) -> None:
    code = (
        "import signal; from functools import partial; from pathlib import Path\n"
        "from test_workers import fail\n"
        "from vrchain.experiments.workers import each\n"
        "if __name__ == '__main__':\n"
        # a shell lets what runs in the background ignore it
        "    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"    each(partial(fail, Path({str(tmp_path)!r})), [2, 3, 4], 2, 'numbers')\n"
    )
    here = str(Path(__file__).parent)
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), here, f"{ROOT}/tests"])},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        deadline_s = time.monotonic() + 60
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline_s:
            time.sleep(0.05)
        if how == signal.SIGINT:
            os.killpg(process.pid, how)  # as a terminal does: to all of them
        else:
            process.send_signal(how)
        assert process.wait(timeout=60) != 0
    finally:
        process.kill()
    workers = [int(file.read_text()) for file in tmp_path.iterdir()]
    assert len(workers) == 2
    if how == signal.SIGINT:  # all were waited for
        for worker in workers:
            with pytest.raises(ProcessLookupError):
                os.kill(worker, 0)
    deadline_s = time.monotonic() + 10
    while any(map(_lives, workers)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not any(map(_lives, workers))


def test_ctrl_c_while_a_process_is_started_is_told_by_no_traceback() -> None:
    """The process would find its orders cut short, and say so in many lines."""
    code = (
        "import os, signal; from multiprocessing import util\n"
        "from vrchain.experiments.workers import each\n"
        "start = util.spawnv_passfds\n"
        "def interrupted(*arguments):\n"
        "    begun = start(*arguments)\n"
        "    if b'spawn_main' in b' '.join(map(os.fsencode, arguments[1])):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    return begun\n"
        "if __name__ == '__main__':\n"
        "    util.spawnv_passfds = interrupted\n"
        "    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "    try:\n"
        "        each(abs, [2, 3], 2, 'numbers')\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (done.stdout, done.returncode) == ("interrupted\n", 0)
    assert "Traceback" not in done.stderr


def _lives(worker: int) -> bool:
    try:
        status = Path(f"/proc/{worker}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"  # or nobody has asked how it ended
