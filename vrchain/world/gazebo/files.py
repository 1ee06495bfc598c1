"""Files of somebody else: where they lie, the way there, and what of them is left out.

Every path is resolved, and stays in the folders given.
"""

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from vrchain.errors import SpecError
from vrchain.world.gazebo.xml import Element

VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH")
_SCHEMES = ("model://", "package://")
_FILE = "file://"


@dataclass(frozen=True)
class Folders:
    """The folders of models, the first that has one wins; the world's own folder besides."""

    models: tuple[Path, ...]
    world: Path

    def find(self, uri: str, beside: Path, element: Element) -> Path | None:
        """The file or folder that a URI names, resolved; None where there is none.

        ``model://NAME/...`` is looked for in every folder of models, ``file://...`` and a path
        without a scheme from the folder ``beside``. Raises SpecError for what leads out of these
        folders, and for other schemes.
        """
        if "\0" in uri:
            raise element.error("a path holds no zero byte")
        if is_elsewhere(uri):
            raise element.error(
                f"expected a path, file:// or model://, got {uri[:200]!r}: nothing is fetched, so "
                f"download the model into a folder of {VARIABLES[0]} and name it by model://"
            )
        if uri.startswith(_SCHEMES):
            roots = allowed = self.models
            rest = uri.partition("://")[2].strip("/")
        else:
            roots, allowed = (beside,), (*self.models, self.world)
            rest = uri = unquote(uri.removeprefix(_FILE)) if uri.startswith(_FILE) else uri
        for root in roots:
            path = _resolved(root / rest)
            if not any(path.is_relative_to(folder) for folder in allowed):
                raise element.error(
                    f"{uri[:200]!r} leads out of the model folders "
                    f"({', '.join(str(a) for a in allowed)}): keep what it names in one of them"
                )
            try:
                if _exists(path):
                    return path
            except SpecError as error:
                raise element.error(str(error)) from None
        return None

    def hold(self, path: Path) -> bool:
        """Whether a path leads into one of these folders."""
        resolved = _resolved(path)
        return any(resolved.is_relative_to(folder) for folder in (*self.models, self.world))

    def __str__(self) -> str:
        return ", ".join(str(root) for root in self.models) or "none is set"


def model_folders(world: Path) -> Folders:
    """The folders of the environment, then ``models`` in the world's folder and beside it."""
    named = [
        Path(folder).expanduser()
        for variable in VARIABLES
        for folder in os.environ.get(variable, "").split(os.pathsep)
        if folder
    ]
    here = _resolved(world.parent)
    near = [here / "models", here.parent / "models"]
    found = [_resolved(folder) for folder in [*named, *(n for n in near if n.is_dir())]]
    return Folders(tuple(dict.fromkeys(found)), here)


def is_elsewhere(uri: str) -> bool:
    """Whether a URI has a scheme of what does not lie on this disk."""
    return "://" in uri and not uri.startswith((*_SCHEMES, _FILE))


def is_file(path: Path) -> bool:
    """Whether a path is a file's. Raises SpecError where that cannot be told."""
    return _exists(path) and path.is_file()


def read_bytes(path: Path, most: int) -> bytes:
    """A file's bytes, at most so many. Raises SpecError."""
    try:
        if not is_file(path):
            raise SpecError(f"{path}: expected a file, found none")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise SpecError(f"{path}: cannot read it: {error.strerror or error}") from error
    if len(data) > most:
        raise SpecError(f"{path}: expected at most {most >> 20} MiB, this file is larger")
    return data


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        raise SpecError(
            f"{str(path)[:300]}: cannot look there ({error.strerror}): expected names of at most "
            "255 bytes, in folders that you may read"
        ) from None


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # a circle of links
        raise SpecError(f"{str(path)[:300]}: cannot follow this path: {error}") from error


class Notes:
    """What of a world is not supported: each kind, with the names of what was left out."""

    def __init__(self) -> None:
        self._found: dict[str, Counter[str]] = {}

    def add(self, kind: str, name: str = "") -> None:
        """One more of a kind, such as "plugins"."""
        self._found.setdefault(kind, Counter())[name] += 1

    def __bool__(self) -> bool:
        return bool(self._found)

    def __str__(self) -> str:
        """Every kind, how often, and the first names."""
        lines = []
        for kind, names in sorted(self._found.items()):
            named = [" ".join(name.split())[:60] for name in names if name]
            told = ", ".join([*named[:4], *(["..."] if len(named) > 4 else [])])
            lines.append(f"{kind}: {names.total()}" + (f" ({told})" if told else ""))
        return "; ".join(lines)
