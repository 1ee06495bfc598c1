"""Packages that name what is in their modules, and load a module when a name of it is first used.

After PEP 562; type checkers learn the names from a TYPE_CHECKING block in the package.
"""

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def lazy(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a package.

    homes: for each name, the module of the package that it is in, "" for the package's own
    modules; ``module:attribute`` where it is called otherwise there.
    """

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, _, attribute = homes[name].partition(":")
        home = importlib.import_module(f"{package}.{module}" if module else package)
        try:
            found = vars(home)[attribute or name]
        except KeyError:  # a module in it
            found = importlib.import_module(f"{home.__name__}.{name}")
        setattr(sys.modules[package], name, found)
        return found

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return get, names
