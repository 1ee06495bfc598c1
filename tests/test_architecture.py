"""Imports run one way, down the levels of docs/architecture.md; special libraries have one home."""

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import vrchain

PACKAGE = Path(vrchain.__file__).parent
ANYWHERE = "vrchain"  # the package itself: its version, and the face that it gives to users

LEVELS = {
    "errors": 0,
    "geometry": 0,
    "seeding": 0,
    "paths": 0,
    "extras": 0,
    "files": 0,
    "allocator": 0,
    "lazy": 0,
    "plugins": 0,
    "yaml_text": 0,
    "panorama": 1,
    "ledger": 1,
    "world": 2,
    "landmarks": 3,
    "homing": 4,
    "robot": 4,
    "publisher": 5,
    "reader": 5,
    "navigation": 5,
    "simulation": 6,
    "experiments": 7,
    "plots": 7,
    "ros": 7,
    "viewer": 8,
    "play": 8,
    "cli": 8,
    "workbench": 8,
}

# Narrower than the levels: what these may know of the rest of the package.
ONLY = {
    "ledger": {
        "errors",
        "seeding",
        "paths",
        "files",
        "extras",
    },  # a payload is bytes and their digest
    "panorama": {"errors", "geometry", "seeding", "files"},
    "homing": {"errors", "geometry", "seeding", "plugins", "panorama", "landmarks"},
    "robot": {"errors", "geometry", "seeding", "panorama", "ledger", "landmarks", "homing"},
    "navigation": {"errors", "geometry", "seeding", "panorama", "landmarks", "homing", "robot"},
}

# Ground truth never leaks into what a robot decides from.
MAY_IMPORT = {
    "world.truth": (
        "simulation",
        "landmarks.training",
        "landmarks.quality",
        "experiments",
        "play",
        "workbench",
    ),
}

# The only homes of libraries that are heavy, fragile or easily scattered.
HOMES = {
    "pyrender": ("world.render",),
    "OpenGL": ("world.render",),
    "open3d": ("world.truth",),
    "torch": ("landmarks",),
    "rosbags": ("ros",),
    "mcap": ("ros",),
    "nats": ("ledger.network",),
    "rospy": ("ros",),
    "rclpy": ("ros",),
}

MOST_MODULES = 16  # in a folder
MOST_LINES = 350  # in a module


def name_of(path: Path, package: Path) -> str:
    """The dotted name below the package: ``world.model`` (``world/__init__.py`` is ``world``)."""
    parts = path.relative_to(package).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def within(name: str, homes: tuple[str, ...]) -> bool:
    return any(name == home or name.startswith(home + ".") for home in homes)


@cache
def nodes(code: str, whole: bool = True) -> tuple[ast.AST, ...]:
    """All of a module, or all but what it tells type checkers alone."""
    tree = ast.parse(code)
    if not whole:
        tree.body = [part for part in tree.body if not for_type_checkers(part)]
    return tuple(ast.walk(tree))


def for_type_checkers(part: ast.stmt) -> bool:
    return isinstance(part, ast.If) and ast.unparse(part.test) == "TYPE_CHECKING"


def imports(path: Path, package: Path) -> Iterator[str]:
    """Every module that a file imports, wherever in the file, with absolute names.

    ``from a import b`` gives ``a.b``: whether b is a module or not, its first parts are a's.
    """
    parents = path.relative_to(package.parent).parent.parts
    face = name_of(path, package) == ""  # it may name what it loads when that is first used
    for node in nodes(path.read_text(encoding="utf-8"), not face):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = parents[: len(parents) - node.level + 1] if node.level else ()
            base += tuple((node.module or "").split(".")) if node.module else ()
            yield from (".".join((*base, alias.name)) for alias in node.names)


def unit(name: str) -> str:
    """What the levels speak of: the first part below the package."""
    return name.partition(".")[0]


def own_imports(path: Path, package: Path) -> Iterator[str]:
    """Names below the package that a file imports; ``ANYWHERE`` for the package itself."""
    for name in imports(path, package):
        first, _, rest = name.partition(".")
        if first == package.name:
            yield ANYWHERE if rest in ("", "__version__") else rest


def module_of(name: str, package: Path) -> str:
    """The module that a name is in: ``world.model`` for ``world.model.Scene``."""
    while name and not any(
        (package / f"{name.replace('.', '/')}{end}").is_file() for end in (".py", "/__init__.py")
    ):
        name = name.rpartition(".")[0]
    return name


def violations(package: Path) -> list[str]:
    """One line for each import, use or module that breaks the architecture."""
    found: list[str] = []
    graph: dict[str, set[str]] = {}
    for path in sorted(package.rglob("*.py")):
        name = name_of(path, package)
        here = unit(name) or ANYWHERE
        if here not in LEVELS and name not in ("", "__main__"):
            found.append(f"{name}: has no level")
            continue
        level = LEVELS.get(here, 0 if name == "" else max(LEVELS.values()))
        for imported in own_imports(path, package):
            there = unit(imported)
            if imported != ANYWHERE:
                graph.setdefault(name, set()).add(module_of(imported, package))
            for secret, homes in MAY_IMPORT.items():
                if within(imported, (secret,)) and not within(name, homes):
                    found.append(f"{name} imports {imported}: ground truth leaks")
            if there in (here, ANYWHERE):
                continue
            if LEVELS.get(there, level + 1) > level:
                found.append(f"{name or ANYWHERE} imports {imported}: upwards")
            if here in ONLY and there not in ONLY[here]:
                found.append(f"{name} imports {imported}: not its business")
        for imported in imports(path, package):
            library = unit(imported)
            if library in HOMES and not within(name, HOMES[library]):
                found.append(f"{name} imports {imported}: only {HOMES[library]} may")
        if not within(name, ("landmarks",)):
            code = nodes(path.read_text(encoding="utf-8"))
            used = {node.attr for node in code if isinstance(node, ast.Attribute)}
            used |= {imported.rpartition(".")[2] for imported in imports(path, package)}
            found += [f"{name} uses {word}: only landmarks may" for word in used if "SIFT" in word]
    try:
        tuple(TopologicalSorter(graph).static_order())
    except ValueError as error:
        found.append(f"modules import each other: {error.args[1]}")
    return found


def test_imports_run_down_the_levels() -> None:
    assert violations(PACKAGE) == []


def test_a_folder_is_a_room_and_a_module_is_read_in_one_sitting() -> None:
    modules = sorted(PACKAGE.rglob("*.py"))
    rooms = Counter(path.parent for path in modules)
    assert [room for room, n in rooms.items() if n > MOST_MODULES] == []
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules}
    assert [path for path, n in lines.items() if n > MOST_LINES] == []


@pytest.mark.parametrize(
    ("module", "source", "complaint"),
    [
        ("geometry", "from vrchain.world.model import Scene", "upwards"),
        ("geometry", "def f():\n    from vrchain import cli", "upwards"),
        ("panorama.rig", "from ..world import Renderer", "upwards"),
        ("panorama.rig", "from .. import world", "upwards"),
        ("", "import vrchain.cli", "upwards"),
        ("world.model", "from vrchain import load_scene", "upwards"),
        ("ledger.chain", "import vrchain.panorama", "not its business"),
        ("robot", "from vrchain.world.model import Scene", "not its business"),
        ("robot", "from vrchain.simulation import Simulator", "not its business"),
        ("navigation", "from vrchain.world.model import Scene", "not its business"),
        ("navigation", "from vrchain.world.truth import GroundTruth", "ground truth leaks"),
        ("landmarks.sift", "from vrchain.world.truth import GroundTruth", "ground truth leaks"),
        ("world.light", "from vrchain.world import truth", "ground truth leaks"),
        ("world.model", "import open3d.core as o3c", "only ('world.truth',) may"),
        ("viewer", "def f():\n    import pyrender", "only ('world.render',) may"),
        ("world.truth", "from OpenGL import GL", "only ('world.render',) may"),
        ("homing", "import torch", "only ('landmarks',) may"),
        ("homing", "import cv2\ncv2.SIFT_create()", "only landmarks may"),
        ("homing", "from cv2 import SIFT_create", "only landmarks may"),
        ("oddments", "", "has no level"),
    ],
)
def test_a_breach_is_named(module: str, source: str, complaint: str, tmp_path: Path) -> None:
    package = small_package(tmp_path, {module: source})
    assert [line for line in violations(package) if complaint in line]


@pytest.mark.parametrize("folder", ["", "world."])
def test_a_circle_within_a_level_is_named(folder: str, tmp_path: Path) -> None:
    sources = {
        f"{folder}errors": f"import vrchain.{folder}paths",
        f"{folder}paths": f"import vrchain.{folder}geometry.Pose",
        f"{folder}geometry": f"def f():\n    from vrchain.{folder}errors import VRChainError",
    }
    assert "import each other" in violations(small_package(tmp_path, sources))[0]


def test_what_is_allowed_passes(tmp_path: Path) -> None:
    sources = {
        "": "if TYPE_CHECKING:\n    from vrchain.world import load_scene as load_scene",
        "cli": "from vrchain import __version__, world\nfrom vrchain.errors import VRChainError",
        "simulation.simulator": "from vrchain.world.truth import GroundTruth\nimport vrchain.robot",
        "landmarks.quality": "from ..world.truth import GroundTruth",
        "landmarks.sift": "import cv2\ncv2.SIFT_create()",
        "world.truth": "def f():\n    import open3d",
        "world.render.drawer": "def f():\n    import pyrender\n    from OpenGL import GL",
    }
    assert violations(small_package(tmp_path, sources)) == []


def small_package(folder: Path, sources: dict[str, str]) -> Path:
    """A package of empty modules, one for each level's names, but for the given sources."""
    package = folder / "vrchain"
    for name in ("", *LEVELS):
        (package / name).mkdir(parents=True)
        (package / name / "__init__.py").touch()
    for name, source in sources.items():
        target = package / name.replace(".", "/")
        target = target / "__init__.py" if target.is_dir() else target.with_suffix(".py")
        target.parent.mkdir(exist_ok=True)
        target.write_text(source)
    return package
