"""Files of somebody else: where they lie, the way there, and what of them is left out.

Every path is resolved, and stays in the folders given.
"""

import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from vrchain.errors import SpecError
from vrchain.world.gazebo.xml import Element

VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH")
_MOST_PARTS = 32  # of a URI, from its end
_FUEL = re.compile(r"^.*?/models/([^/]+)(?:/(?:\d+|tip))?(?:/files)?(?=/|$)")


@dataclass(frozen=True)
class Folders:
    """The folders of models, the first that has one wins; the world's own folder besides."""

    models: tuple[Path, ...]
    world: Path

    def find(self, uri: str, beside: Path, element: Element) -> Path | None:
        """The file or folder that a URI names, resolved; None where there is none in the folders.

        ``file://...`` and a path without a scheme are looked for from the folder ``beside``; a URI
        of any scheme, as ``model://`` or ``https://``, in every folder of models: all of it, then
        less and less from its end, as users have set roots of many depths. Nothing that leads out
        of these folders is found. Raises SpecError for what cannot be looked for.
        """
        if "\0" in uri:
            raise element.error("a path holds no zero byte")
        scheme, named, rest = uri.rpartition("://")
        near = (rest, unquote(rest)) if scheme == "file" else (rest,) if not named else ()
        places = [beside / spelt for spelt in near]
        if named:
            tails = dict.fromkeys(tail for spelt in _spellings(rest) for tail in _tails(spelt))
            places += [folder / tail for tail in tails for folder in self.models]
        try:
            return next((path for place in places if (path := self._held(place)) is not None), None)
        except SpecError as error:
            raise element.error(str(error)) from None

    def _held(self, place: Path) -> Path | None:
        """What lies at a path, resolved; None where nothing does or the path leads out."""
        path = _resolved(place)
        allowed = any(path.is_relative_to(folder) for folder in (*self.models, self.world))
        if not allowed:
            _noted("way", place)  # which may lead elsewhere tomorrow
            return None
        return path if _noted("path", place) else None

    def hold(self, path: Path) -> bool:
        """Whether a path leads into one of these folders."""
        resolved = Path(_noted("way", path))
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


def _spellings(rest: str) -> list[str]:
    """Paths that a URI without its scheme may mean; those of a Fuel server as users store them."""
    spelt = list(dict.fromkeys((rest, unquote(rest))))
    if (found := _FUEL.match(spelt[-1])) is not None:
        name, within = found[1], spelt[-1][found.end() :]
        bare = name.replace(" ", "_")
        spelt += [n + within for n in (name, bare, name.lower(), bare.lower())]
    return spelt


def _tails(path: str) -> list[str]:
    """A path, then without its first part, its first two, and so on; none of them leads upwards."""
    parts = [part for part in path.split("/") if part not in ("", ".")][-_MOST_PARTS:]
    first = max((k + 1 for k, part in enumerate(parts) if part == ".."), default=0)
    return ["/".join(parts[k:]) for k in range(first, len(parts))]


def is_file(path: Path) -> bool:
    """Whether a path is a file's. Raises SpecError where that cannot be told."""
    return _noted("kind", path) == "file"


def files_in(folder: Path, pattern: str) -> list[Path]:
    """The files of a folder whose names have a pattern, in order; none if it is no folder."""
    return [folder / name for name in _noted(f"names {pattern}", folder).split("/") if name]


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
    if (seen := _WATCHED.get()) is not None:
        seen.note("bytes", path, hashlib.sha256(data).hexdigest())
    return data


@dataclass(frozen=True)
class Watched:
    """What was looked at: (what of it, path, answer), each once."""

    found: dict[tuple[str, str, str], None]

    def note(self, what: str, path: Path, answer: str) -> None:
        """One more."""
        self.found[what, str(path), answer] = None

    def still_holds(self) -> bool:
        """Whether all is as it was."""
        return all(_look(what, Path(path)) == answer for what, path, answer in self.found)


_WATCHED: ContextVar[Watched | None] = ContextVar("watched", default=None)


@contextmanager
def watching() -> Iterator[Watched]:
    """Note what is looked at in files and folders while the block runs."""
    token = _WATCHED.set(Watched({}))
    try:
        seen = _WATCHED.get()
        assert seen is not None
        yield seen
    finally:
        _WATCHED.reset(token)


def _noted(what: str, path: Path) -> str:
    answer = _look(what, path)
    if (seen := _WATCHED.get()) is not None:
        seen.note(what, path, answer)
    return answer


def _look(what: str, path: Path) -> str:
    """What is at a path: where a link leads, which kind, which names, or a digest; "" for none.

    The way of a path is where it leads, whether or not something is there.
    """
    if what == "way":
        return str(_resolved(path))
    if what == "path":
        resolved = _resolved(path)
        return str(resolved) if _exists(resolved) else ""
    if what == "kind":
        return "file" if _exists(path) and path.is_file() else ""
    if what == "bytes":
        if not path.is_file():
            return ""
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    found = path.glob(what.removeprefix("names ")) if path.is_dir() else ()
    return "/".join(sorted(f.name for f in found if f.is_file()))


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
        self._lost: dict[str, Counter[str]] = {}

    def add(self, kind: str, name: str = "") -> None:
        """One more of a kind, such as "plugins"."""
        self._found.setdefault(kind, Counter())[name] += 1

    def lose(self, kind: str, name: str) -> None:
        """One more file of a kind, such as "meshes that are missing"; all of them are named."""
        self._lost.setdefault(kind, Counter())[name] += 1

    @property
    def lost(self) -> str:
        """The files that are not there or broken, "" if there are none."""
        return _listed(self._lost, None, 400)

    def __bool__(self) -> bool:
        return bool(self._found or self._lost)

    def __str__(self) -> str:
        """Every kind, how often, and the first names; of files that are not there all names."""
        return "; ".join(told for told in (self.lost, _listed(self._found, 4, 60)) if told)


def _listed(found: dict[str, Counter[str]], most: int | None, letters: int) -> str:
    """Kinds, how often each, and so many names of it, cut to so many letters."""
    lines = []
    for kind, names in sorted(found.items()):
        named = [" ".join(name.split())[:letters] for name in names if name]
        told = ", ".join([*named[:most], *(["..."] if named[:most] != named else [])])
        lines.append(f"{kind}: {names.total()}" + (f" ({told})" if told else ""))
    return "; ".join(lines)
