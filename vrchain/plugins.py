"""What somebody's own module adds to a table: MODULE:NAME."""

import hashlib
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vrchain.errors import MissionError


def plugged_in(name: str, what: str, known: str, fits: Callable[[Any], bool]) -> tuple[Any, str]:
    """What MODULE:NAME is, of a module that Python finds or in the current folder, and its digest.

    what: it should be; known: those that there are, for who asks for another; fits: whether it is
    one. MissionError if it is none, is not there, or if its module fails, in whatever way.
    """
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    source, found, why = None, None, ""
    if attribute:
        try:
            source = importlib.import_module(module)
            found = getattr(source, attribute)
            why = f" ({name} is a {type(found).__name__}, not a {what})"
        except (Exception, SystemExit) as error:
            why = f" ({type(error).__name__}: {' '.join(str(error).split())})"
    if source is None or not fits(found):
        raise MissionError(
            f"no {what} {name!r}{why}: there are {known}; and MODULE:NAME of your own"
        )
    spec = getattr(source, "__spec__", None)
    reads = getattr(spec and spec.loader, "get_data", None)  # from a file or a zip
    origin = spec.origin if spec else None
    return found, hashlib.sha256(reads(origin)).hexdigest() if reads and origin else ""
