"""A scene file (YAML) read into frozen dataclasses; every mistake in it is named.

A field's allowed range stands beside its default, and error messages quote it.
"""

from dataclasses import Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from vrchain.errors import SpecError
from vrchain.paths import scene_file
from vrchain.yaml_text import load_yaml

_Spec = TypeVar("_Spec")


def _within(default: Any, low: float, high: float) -> Any:
    """A field with its allowed range, ends included."""
    return field(default=default, metadata={"range": (low, high)})


def _choice(*options: str) -> Any:
    """A field that is one of some words, the first unless another is given."""
    return field(default=options[0], metadata={"options": options})


@dataclass(frozen=True)
class StreetSpec:
    """The road network: streets beside and across one another, drawn anew for every seed."""

    width_m: float = _within(7.0, 5.0, 12.0)  # between the kerbs
    pavement_m: float = _within(1.9, 1.2, 4.0)  # each side
    bend_m: float = _within(2.5, 0.0, 4.0)  # how much a street swings and turns, 0: straight
    spacing_m: float = _within(65.0, 60.0, 200.0)  # between neighbouring streets, about


@dataclass(frozen=True)
class HouseSpec:
    """Houses, one a lot, facing their street."""

    count: int = _within(32, 0, 500)  # how many
    setback_m: tuple[float, float] = _within((5.2, 7.0), 4.0, 8.0)  # pavement to front wall
    two_storey: float = _within(0.35, 0.0, 1.0)  # share of houses with an upper floor


@dataclass(frozen=True)
class ShopSpec:
    """Shops, side by side on lots along a street."""

    count: int = _within(3, 0, 40)  # how many


@dataclass(frozen=True)
class BarnSpec:
    """Barns on lots at the map's rim."""

    count: int = _within(1, 0, 20)  # how many


@dataclass(frozen=True)
class TreeSpec:
    """Trees in gardens and along streets."""

    count: int = _within(80, 0, 2000)  # how many
    height_m: tuple[float, float] = _within((4.5, 9.5), 2.5, 25.0)  # smallest and tallest


@dataclass(frozen=True)
class VehicleSpec:
    """Parked cars, vans and pickups."""

    count: int = _within(20, 0, 400)  # how many
    in_driveway: float = _within(0.5, 0.0, 1.0)  # share parked in driveways, the rest at kerbs


@dataclass(frozen=True)
class BoundarySpec:
    """What divides lots: runs of at most 8 m, each one object."""

    fences: int = _within(40, 0, 800)  # runs of picket, board or rail fence
    walls: int = _within(16, 0, 400)  # runs of brick or stone wall
    hedges: int = _within(18, 0, 400)  # runs of clipped hedge


@dataclass(frozen=True)
class FurnitureSpec:
    """Small things along streets and in front yards."""

    mailboxes: int = _within(26, 0, 400)  # at the pavement, by driveways
    lamps: int = _within(24, 0, 400)  # street lamps
    poles: int = _within(10, 0, 200)  # utility poles
    signs: int = _within(12, 0, 200)  # road signs
    bins: int = _within(18, 0, 400)  # wheeled bins beside houses and at kerbs
    hydrants: int = _within(6, 0, 200)  # on the pavement
    bushes: int = _within(30, 0, 800)  # shrubs before houses and in gardens


@dataclass(frozen=True)
class LightSpec:
    """The light that is baked into the scene; a file's ``time`` sets what else it leaves out."""

    time: str = _choice("noon", "evening", "overcast")  # colours of light and sky; see _TIMES
    sun_azimuth_deg: float = _within(235.0, 0.0, 360.0)  # anticlockwise from east
    sun_elevation_deg: float = _within(46.0, 10.0, 85.0)  # above the horizon
    ambient: float = _within(0.6, 0.2, 1.0)  # brightness of a face that the sun does not reach


@dataclass(frozen=True)
class SceneSpec:
    """Everything that, with its seed, determines a scene."""

    name: str = "suburb"  # shown in tables and titles
    layout: str = _choice("suburb", "barn")  # barn: the paper's, see suburb/barnyard.py
    seed: int = _within(2000, 0, 2**63 - 1)  # of every random choice
    extent_m: tuple[float, float] = _within((130.0, 180.0), 60.0, 600.0)  # x by y, origin centred
    streets: StreetSpec = StreetSpec()
    houses: HouseSpec = HouseSpec()
    shops: ShopSpec = ShopSpec()
    barns: BarnSpec = BarnSpec()
    trees: TreeSpec = TreeSpec()
    vehicles: VehicleSpec = VehicleSpec()
    boundaries: BoundarySpec = BoundarySpec()
    furniture: FurnitureSpec = FurnitureSpec()
    season: str = _choice("summer", "autumn", "winter", "spring")  # colours of leaves and grass
    light: LightSpec = LightSpec()
    twins: float = _within(0.0, 0.0, 1.0)  # share of houses and vehicles that repeat others


# What a time of day sets; for noon it is LightSpec's defaults.
_TIMES: dict[Any, dict[str, float]] = {
    "evening": {"sun_azimuth_deg": 212.0, "sun_elevation_deg": 14.0, "ambient": 0.5},
    "overcast": {"sun_azimuth_deg": 235.0, "sun_elevation_deg": 60.0, "ambient": 0.65},
}
_SUBURB_ONLY = (
    "extent_m", "streets", "houses", "shops", "barns", "trees", "vehicles", "boundaries",
    "furniture", "twins",
)  # fmt: skip
# The ground that one thing needs at the very least, in square metres: a first check of densities.
_LEAST_AREA_M2 = {
    "houses": 300.0, "shops": 300.0, "barns": 300.0, "trees": 14.0, "vehicles": 40.0,
}  # fmt: skip


def load_spec(path: str | Path) -> SceneSpec:
    """Read a scene file. Raises SpecError, naming the file and the key, on anything amiss."""
    path = scene_file(path)
    if path.is_dir():
        raise SpecError(f"{path} is a folder: give a scene file such as scenes/suburb.yaml")
    try:
        document = load_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SpecError(
            f"no scene file {path}: check the path, or use scenes/suburb.yaml"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SpecError(f"cannot read {path} as a scene file: {error}") from error
    except (yaml.YAMLError, ValueError, KeyError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split())  # PyYAML raises all of these
        raise SpecError(f"{path} is not valid YAML: {reason}") from error
    if not isinstance(document, dict):
        found = "nothing" if document is None else f"a {type(document).__name__}"
        raise SpecError(f"{path}: expected keys and values such as `seed: 2000`, got {found}")
    try:
        return parse_spec(document)
    except SpecError as error:
        raise SpecError(f"{path}: {error}") from None


def parse_spec(document: dict[str, Any]) -> SceneSpec:
    """A spec from its keys; what is left out takes its default. Raises SpecError."""
    light = document.get("light")
    if isinstance(light, dict) and light.get("time") in tuple(_TIMES):
        document = {**document, "light": {**_TIMES[light["time"]], **light}}
    spec = _read(SceneSpec, document, "")
    given = [key for key in document if key in _SUBURB_ONLY]
    if spec.layout == "barn" and given:
        raise SpecError(f"{given[0]}: the layout 'barn' has a plan of its own, leave it out")
    area = spec.extent_m[0] * spec.extent_m[1]
    for key, least in _LEAST_AREA_M2.items():
        count, most = getattr(spec, key).count, int(area / least)
        if count > most:
            raise SpecError(
                f"{key}.count: {count} cannot be placed on {area:g} m2, allowed 0..{most}"
            )
    return spec


def _read(cls: type[_Spec], document: Any, prefix: str) -> _Spec:
    if not isinstance(document, dict):
        raise SpecError(f"{prefix[:-1]}: expected keys and values, got {document!r}")
    hints = get_type_hints(cls)
    known = {f.name: f for f in fields(cls)}  # type: ignore[arg-type]
    for key in document:
        if key not in known:
            raise SpecError(
                f"unknown key '{prefix}{key}': known here are {', '.join(sorted(known))}"
            )
    return cls(**{k: _value(known[k], hints[k], v, prefix + k) for k, v in document.items()})


def _value(spec_field: "Field[Any]", hint: Any, value: Any, key: str) -> Any:
    if is_dataclass(hint):
        return _read(hint, value, key + ".")  # type: ignore[arg-type]
    if hint is str:
        if not isinstance(value, str) or not value.strip():
            raise SpecError(f"{key}: expected a name, got {value!r}")
        options = spec_field.metadata.get("options", (value,))
        if value not in options:
            raise SpecError(f"{key}: expected one of {', '.join(options)}, got {value!r}")
        return value
    low, high = spec_field.metadata["range"]
    if get_origin(hint) is tuple:
        n = len(get_args(hint))
        if not isinstance(value, list) or len(value) != n:
            raise SpecError(
                f"{key}: expected a list of {n} numbers, each {low:g}..{high:g}, got {value!r}"
            )
        pair = tuple(_number(v, float, low, high, key) for v in value)
        if key != "extent_m" and pair[0] > pair[1]:
            raise SpecError(f"{key}: expected the smaller number first, got {value!r}")
        return pair
    return _number(value, hint, low, high, key)


def _number(value: Any, kind: type, low: float, high: float, key: str) -> Any:
    word = "a whole number" if kind is int else "a number"
    accepted = (int,) if kind is int else (int, float)
    if type(value) not in accepted:  # a bool is an int to isinstance
        raise SpecError(f"{key}: expected {word} in {low:g}..{high:g}, got {value!r}")
    if not low <= value <= high:  # nor is NaN
        raise SpecError(f"{key}: {value!r} is not allowed, give {word} in {low:g}..{high:g}")
    return kind(value)
