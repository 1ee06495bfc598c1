"""The command ``vrchain``: readable text, or one JSON object with ``--json``.

Exit status 0, or not 0 with one line that says what was expected, what came, how to mend it.
"""

import signal
import sys
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any, TextIO

import typer

from vrchain import __version__
from vrchain.allocator import keep_freed_memory
from vrchain.cli import (
    bags,
    bench,
    cluster,
    evaluate_driving,
    ledger,
    panorama,
    research,
    robot,
    robots,
    scene,
)
from vrchain.errors import UnsupportedWarning, VRChainError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Visual homing for teams of robots that share what they see through a ledger.",
)
app.add_typer(scene.app, name="scene")
app.add_typer(panorama.app, name="panorama")
app.add_typer(ledger.app, name="ledger")
ledger.app.command()(cluster.watch)
app.add_typer(cluster.app, name="cluster")
app.add_typer(bags.app, name="bag")
app.add_typer(robot.app, name="robot")
app.add_typer(bench.app, name="bench")
app.add_typer(evaluate_driving.app, name="evaluate")
app.command()(robots.landmarks)
app.command()(robots.navigate)
app.command()(research.reproduce)
app.command()(research.figures)
app.command()(research.train)


@app.command()
def version() -> None:
    """Print the version."""
    print(__version__)


def main() -> None:
    """Run the command line; errors of use become one line and an exit status."""
    keep_freed_memory()
    interrupts: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)  # libraries may turn what is raised into errors of their own
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):  # ended either way, no process is left behind
        signal.signal(number, interrupt)
    warnings.showwarning = _warn
    status = 1
    try:
        status = app(standalone_mode=False)
    except VRChainError as error:
        if not interrupts:
            status = _fail(" ".join(str(error).split()), 1)
    except typer.TyperException as error:
        told = _told(error)  # nothing where help was asked for by saying nothing
        status = _fail(f"{told} (see `vrchain --help`)", 2) if told else 0
    except OSError as error:  # what it prints goes to a full disk, perhaps
        if not interrupts:
            status = _fail(f"{error.filename or 'what is printed'}: {error.strerror or error}", 1)
    except BaseException:
        if not interrupts:
            raise
    if interrupts:
        status = _fail("interrupted: nothing half-written is left", 128 + interrupts[0])
    sys.exit(status)


def _told(error: typer.TyperException) -> str:
    """What was wrong, what came, and what an option of more than one value takes."""
    told = error.format_message()
    if refused := getattr(error.__cause__, "errors", None):
        told += f", got {refused()[0]['input']!r}"
    about = {
        getattr(error, "option_name", None),
        *getattr(getattr(error, "param", None), "opts", ()),
    }
    for option in _options(typer.main.get_command(app)):
        if option.nargs > 1 and about & {*option.opts}:
            return f"{told.removesuffix('.')}: expected {option.opts[0]} {option.metavar}"
    return told


def _options(command: Any) -> Iterator[Any]:
    yield from command.params
    for below in getattr(command, "commands", {}).values():
        yield from _options(below)


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """What a world holds that we do not draw is told in a line; other warnings as ever."""
    told = warnings.formatwarning(message, category, filename, lineno, line)
    if issubclass(category, UnsupportedWarning):
        told = f"vrchain: {message}\n"
    (file or sys.stderr).write(told)


def _fail(message: str, status: int) -> int:
    print(f"vrchain: {message}", file=sys.stderr)
    return status
