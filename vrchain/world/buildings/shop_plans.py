"""Plans of shops: their measures, their parts, and the invented name over the door."""

from dataclasses import dataclass

import numpy as np
import shapely

from vrchain.world.buildings.house_plans import STOREY_M, Rect

GROUND_FLOOR_M = 3.5  # height of the ground floor, its sign included
_TRADES = (
    ("BAKERY", "BREAD", "CAKES", "PIES"),
    ("BOOKS", "MAPS", "PRINTS", "NOVELS"),
    ("CAFE", "COFFEE", "TEA", "SOUP"),
    ("BARBER", "CUTS", "SHAVES", "WIGS"),
    ("FLOWERS", "ROSES", "WREATHS", "BULBS"),
    ("GROCER", "FRUIT", "CHEESE", "EGGS"),
    ("HARDWARE", "TOOLS", "NAILS", "PAINT"),
    ("PHARMACY", "PILLS", "SOAP", "TONICS"),
    ("TOYS", "GAMES", "KITES", "DOLLS"),
    ("SHOES", "BOOTS", "HEELS", "LACES"),
    ("BIKES", "TYRES", "REPAIRS", "BELLS"),
    ("RECORDS", "VINYL", "TAPES", "GUITARS"),
    ("TAILOR", "SUITS", "COATS", "HATS"),
    ("BUTCHER", "BEEF", "HAM", "SAUSAGE"),
    ("LAUNDRY", "WASH", "PRESS", "DRY"),
    ("CLOCKS", "WATCHES", "REPAIRS", "RINGS"),
    ("FABRICS", "WOOL", "SILK", "YARN"),
    ("PETS", "SEED", "FISH", "BIRDS"),
    ("CAMERAS", "FILM", "FRAMES", "LENSES"),
    ("NOODLES", "RICE", "BROTH", "DUMPLINGS"),
)
_FIRST = (
    "Al", "Bel", "Cas", "Dor", "El", "Fen", "Gar", "Hol", "Ing", "Jas", "Kel", "Lor", "Mar",
    "Nor", "Os", "Pen", "Quil", "Ros", "Sel", "Tor", "Um", "Ven", "Wal", "Yar", "Zel",
)  # fmt: skip
_LAST = (
    "bury", "combe", "dale", "der", "ford", "gan", "holm", "kin", "lett", "mond", "ner", "pole",
    "rick", "sby", "ton", "vane", "well", "wick", "worth", "zano",
)  # fmt: skip


@dataclass(frozen=True)
class ShopPlan:
    """Where the parts of a shop stand, in the model frame, and what it is called."""

    main: Rect
    storeys: int
    roof: str  # "flat", "gable_x" (ridge along the front), "gable_y" (gable to the front) or "hip"
    pitch: float  # rise over run
    door: float  # where in the front the door is, 0..1
    bays: int  # display windows
    shelter: str  # over the windows: "awning" (sloped cloth), "canopy" (a slab) or "none"
    hanging: bool  # a second sign that stands out from the wall
    board: bool  # a third one on posts upon a flat roof
    advert_side: int  # -1 or 1: an advertisement painted on that side wall; 0: none
    name: str
    trade: str
    wares: tuple[str, ...]

    @property
    def top_m(self) -> float:
        """Height of the walls, without a flat roof's parapet."""
        return GROUND_FLOOR_M + (self.storeys - 1) * STOREY_M + 0.2

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (along the street) and depth."""
        return self.main.width_m, self.main.depth_m

    @property
    def outline(self) -> shapely.Geometry:
        """Outline on the ground, as ``SceneObject.footprint`` has it."""
        return shapely.box(self.main.x0, self.main.y0, self.main.x1, self.main.y1)


def draw_plan(rng: np.random.Generator) -> ShopPlan:
    """A random shop of 7.5 to 12 m by 7 to 10 m."""
    w, d = rng.uniform(7.5, 12.0), rng.uniform(7.0, 10.0)
    storeys = 2 if rng.random() < 0.45 else 1
    roof = str(rng.choice(["flat", "gable_x", "gable_y", "hip"], p=[0.5, 0.2, 0.2, 0.1]))
    trade, *wares = _TRADES[int(rng.integers(len(_TRADES)))]
    owner = str(rng.choice(_FIRST)) + str(rng.choice(_LAST))
    forms = (owner, owner + "'s", owner + " & Co", owner + " & Sons", "The " + owner)
    return ShopPlan(
        main=Rect(-w / 2, -d / 2, w / 2, d / 2),
        storeys=storeys,
        roof=roof,
        pitch=float(rng.uniform(0.35, 0.6)),
        door=float(rng.choice([0.13, 0.5, 0.87])),
        bays=int(rng.integers(2, 5)),
        shelter=str(rng.choice(["awning", "canopy", "none"], p=[0.5, 0.2, 0.3])),
        hanging=bool(rng.random() < 0.5),
        board=bool(roof == "flat" and rng.random() < 0.4),
        advert_side=int(rng.integers(-1, 2)),
        name=str(rng.choice(forms)),
        trade=trade,
        wares=tuple(wares),
    )
