"""Where the project's own files are, in a checkout or in an installed package."""

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_PACKED = _PACKAGE / "project"  # where a wheel has scenes, figures, notebooks: pyproject.toml
INSTALLED = _PACKED.is_dir()
ROOT = _PACKAGE.parent  # whence Python imports the package
_FILES = _PACKED if INSTALLED else ROOT
SCENES = _FILES / "scenes"
NOTEBOOKS = _FILES / "notebooks"
FIGURES = _FILES / "figures"

# What is written goes into a checkout, else where the user is: never into an installed package.
_HERE = Path() if INSTALLED else ROOT
BUILD = Path(os.environ.get("VRCHAIN_BUILD") or _HERE / "build")
DRAWN = _HERE / "figures"


def scene_file(path: str | Path) -> Path:
    """The file, or the project's own of that name where there is none: ``scenes/suburb.yaml``."""
    path = Path(path)
    own = SCENES.parent / path
    ours = path.parts[:1] == (SCENES.name,) and os.path.exists(own) and not os.path.exists(path)
    return own if ours else path
