"""What several commands take and say: their options, and what is refused before any work."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vrchain.errors import OutputError
from vrchain.files import check_output_file
from vrchain.paths import SCENES

if TYPE_CHECKING:
    from vrchain.navigation.settings import Decision
    from vrchain.world.spec import SceneSpec

Spec = Annotated[Path, typer.Argument(metavar="SPEC", help="A scene file or Gazebo world.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="Refuse a Gazebo world of which a file is missing.")
]
Model = Annotated[
    str | None,
    typer.Option(
        help="What a pixel's place means: equirectangular, cylinder, mirror, fisheye, cubemap or "
        "views; asked for where the picture's metadata do not tell."
    ),
]
SUBURB = SCENES / "suburb.yaml"
SpecOrSuburb = Annotated[
    Path,
    typer.Argument(
        metavar="[SPEC]",
        help="A scene file or Gazebo world.",
        show_default="scenes/suburb.yaml",  # without the folder that it lies in
    ),
]
Folder = Annotated[
    Path,
    typer.Option(
        "-o", "--output", metavar="DIR", help="Folder to write; an earlier result is replaced."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="One JSON object instead of text.")]


def suburb_of(spec: Path) -> "SceneSpec | None":
    """What is to be built, if it is a suburb of ours: it tells what to refuse before that."""
    from vrchain.world.gazebo import SUFFIXES
    from vrchain.world.spec import load_spec

    read = None if spec.suffix.lower() in SUFFIXES else load_spec(spec)
    return read if read and read.layout == "suburb" else None


def check_picture(path: Path) -> None:
    """Raise OutputError unless a PNG can be written there."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"expected a picture's name that ends in .png, got {path}")
    check_output_file(path)


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Say at a terminal what takes long, for as long as it does; elsewhere nothing, as tqdm."""
    at_terminal = sys.stderr.isatty()
    if at_terminal:
        print(f"{what} ...", end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        if at_terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def teller(silent: bool) -> "Callable[[Decision], None]":
    """What prints a mission's decisions as they are made, unless ``silent``."""

    def tell(decision: "Decision") -> None:
        if not silent:
            print(f"{decision.time_s:7.1f} s  {decision.what:10} {decision.why}", flush=True)

    return tell
