"""What somebody's own module adds to a table: MODULE:NAME."""

import hashlib
import importlib
import sys
from pathlib import Path
from typing import Any


def plugged_in(name: str) -> tuple[Any, str]:
    """What MODULE:NAME is, of a module that Python finds, or in the current folder; by its content.

    None, and why: there is no such thing, or its module fails, in whatever way.
    """
    module, _, attribute = name.partition(":")
    if not attribute:
        return None, ""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        source = importlib.import_module(module)
        found = getattr(source, attribute)
    except Exception as error:
        return None, f"{type(error).__name__}: {' '.join(str(error).split())}"
    file = getattr(source, "__file__", None)
    return found, hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
