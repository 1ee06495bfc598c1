"""COLLADA files, looked at before pycollada takes them for something else or fills memory."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from vrchain.errors import SpecError


def check_collada(data: bytes, file: Path) -> tuple[float, str]:
    """Metres per unit and the axis that is up, "" where none is said. Raises SpecError.

    data: XML without a DTD.
    """
    root = ElementTree.fromstring(data)
    for geometry in root.iterfind("{*}library_geometries/{*}geometry"):
        for mesh in geometry.iterfind("{*}mesh"):
            where = f"{file}: the geometry {geometry.get('id', '')!r}"
            _check_sources(mesh, where)
            for polygons in mesh.iterfind("{*}polylist"):
                _check_counts(polygons, where)
    up_axis = root.findtext("{*}asset/{*}up_axis") or ""
    return _unit_m(root.find("{*}asset/{*}unit"), file), up_axis.strip()


def _unit_m(unit: ElementTree.Element | None, file: Path) -> float:
    given = "1" if unit is None else unit.get("meter", "1")
    try:
        unit_m = float(given)
    except ValueError:
        unit_m = math.nan
    if not 0 < unit_m < math.inf:
        raise SpecError(f'{file}: <unit meter="{given[:60]}">: expected metres, more than 0')
    return unit_m


def _check_sources(mesh: ElementTree.Element, where: str) -> None:
    known = {f"#{source.get('id')}" for source in mesh.iterfind("{*}source")}
    for given in mesh.iterfind("{*}vertices/{*}input"):
        if given.get("source") not in known:
            raise SpecError(
                f"{where}: its <vertices> name the source {given.get('source', '')[:60]!r}, "
                "which it does not have"
            )


def _check_counts(polygons: ElementTree.Element, where: str) -> None:
    """pycollada makes room for as many corners as <vcount> says, whatever <p> holds."""
    try:
        counts, indices = (
            np.fromstring((polygons.findtext(tag) or "").strip(), dtype=float, sep=" ")
            for tag in ("{*}vcount", "{*}p")
        )
        offsets = [int(given.get("offset", "0")) for given in polygons.iterfind("{*}input")]
    except ValueError:
        raise SpecError(
            f"{where}: expected whole numbers in the <vcount>, <p> and offsets of its <polylist>"
        ) from None
    named = counts.sum() * (1 + max(offsets, default=0))
    if counts.min(initial=0) < 0 or named > len(indices):
        raise SpecError(
            f"{where}: the <vcount> of its <polylist> names {named:.0f} indices, its <p> has "
            f"{len(indices)}"
        )
