"""What a model of somebody else's is: guessed from its name, then from its shape."""

import re

# The first kind one of whose words is in a name: a lamp_post is a lamp, not a pole.
_WORDS: tuple[tuple[str, str], ...] = (
    ("robot", "robot pioneer turtlebot husky jackal pr2 irobot quadrotor drone iris rover"),
    ("person", "person pedestrian walking standing actor human casual man woman"),
    ("sign", "sign signpost billboard speed_limit"),
    ("lamp", "lamp light lamppost streetlight stoplight"),
    ("mailbox", "mailbox postbox"),
    ("hydrant", "hydrant"),
    ("cone", "cone"),
    ("bin", "dumpster bin trash garbage wastebasket"),
    ("ground", "ground plane asphalt road street sidewalk pavement kerb curb crosswalk marking "
               "grass terrain lawn parking floor heightmap lane intersection driveway "
               "ocean sea lake river water"),
    ("hedge", "hedge"),
    ("fence", "fence railing guardrail"),
    ("wall", "wall"),
    ("barrier", "barrier jersey"),
    ("bush", "bush shrub"),
    ("tree", "tree pine oak birch palm fir spruce"),
    ("pole", "pole post mast pylon"),
    ("vehicle", "suv hatchback car truck van bus pickup prius ambulance taxi sedan jeep tractor "
                "trailer firetruck vehicle motorcycle bicycle bike"),
    ("barn", "barn silo"),
    ("house", "house home cottage villa bungalow"),
    ("shop", "grocery store shop market supermarket cafe restaurant bakery thrift salon mall "
             "gas_station gasoline kiosk"),
    ("building", "station office building hospital school church tower warehouse garage apartment "
                 "bank hotel library museum workshop factory post_office hangar shed"),
)  # fmt: skip
_KINDS = {word: kind for kind, words in reversed(_WORDS) for word in words.split()}
_WHOLE = ("gas_station", "post_office", "speed_limit")  # of two words, looked for first
_ROBOT_M = 3.0
_PERSON_M = (2.5, 2.7)  # lying or with arms out, and high
_VEHICLE_M = (4.5, 30.0)  # wide and long at most
_FLAT_M, _WIDE_M = 0.25, 2.0
_FLAT_SHARE = 0.03  # of its lesser side, that hilly ground may be high
_SLIM_M, _TALL_M = 0.8, 2.0
_BUILDING_M = (5.0, 5.0, 2.5)
_LEAST_BUILDING_M = (2.5, 2.0)  # wide and high: what is named after a warehouse may be a pallet
_BUILDINGS = ("house", "shop", "building", "barn")


def guess(name: str, size_m: tuple[float, float, float], leafy: bool) -> str:
    """The kind of a model of this name and size; leafy: whether most of it is cut out.

    A name says more than a shape, but only what is flat is ground: a road barrier is not; and a
    house whose name holds "turtlebot3" is no robot, nor an elevator car a vehicle.
    """
    x_m, y_m, z_m = size_m
    wide_m, long_m = sorted((x_m, y_m))
    fits = {
        "ground": z_m < max(_FLAT_M, _FLAT_SHARE * wide_m),
        "robot": max(size_m) <= _ROBOT_M,
        "person": long_m <= _PERSON_M[0] and z_m <= _PERSON_M[1],
        "vehicle": z_m < long_m <= _VEHICLE_M[1] and wide_m <= _VEHICLE_M[0],
        **dict.fromkeys(_BUILDINGS, wide_m >= _LEAST_BUILDING_M[0] and z_m >= _LEAST_BUILDING_M[1]),
    }
    named = _named(name, {kind for kind, it_does in fits.items() if not it_does})
    if named:
        return named
    if z_m < _FLAT_M and max(x_m, y_m) > _WIDE_M:
        return "ground"
    if leafy:
        return "tree" if z_m > _TALL_M else "bush"
    if max(x_m, y_m) < _SLIM_M and z_m > _TALL_M:
        return "pole"
    if min(x_m, y_m) > _BUILDING_M[0] and z_m > _BUILDING_M[2]:
        return "building"
    return "object"


def _named(name: str, unfit: set[str]) -> str | None:
    """The kind that a name's words tell, if any, but none of those that do not fit."""
    lowered = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    for word in _WHOLE:
        if word in lowered and _KINDS[word] not in unfit:
            return _KINDS[word]
    words = re.split(r"[^a-z]+", lowered) + re.split(r"[^a-z0-9]+", lowered)
    kinds = {_KINDS[w] for w in words if w in _KINDS} - unfit
    return next((kind for kind, _ in _WORDS if kind in kinds), None)
