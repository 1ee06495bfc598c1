"""Kinds of vehicles and their measures."""

from dataclasses import dataclass

from numpy.random import Generator

BOTTOM_M = 0.24  # clearance under the body


@dataclass(frozen=True)
class VehiclePlan:
    """Measures of a vehicle and the outline of its cabin as fractions of its length."""

    style: str  # "car", "estate", "hatch", "suv", "van" or "pickup"
    length_m: float
    width_m: float
    belt_m: float  # height of the windows' lower edge
    roof_m: float
    bonnet_m: float  # height of the front
    # Windscreen's foot, roof's front, roof's rear, rear window's foot; from the rear.
    cabin: tuple[float, float, float, float]
    tail_m: float  # height behind the cabin

    @property
    def name(self) -> str:
        """What a passer-by would call it: car, van or pickup."""
        return self.style if self.style in ("van", "pickup") else "car"

    @property
    def axles(self) -> tuple[float, float]:
        """Where the wheels are, from the rear, as fractions of the length."""
        return (0.2, 0.81) if self.style != "van" else (0.19, 0.83)


# length, width, belt, roof, bonnet, cabin, tail
_STYLES = {
    "car": (4.5, 1.78, 0.92, 1.43, 0.78, (0.70, 0.56, 0.30, 0.14), 0.9),
    "estate": (4.6, 1.8, 0.93, 1.48, 0.8, (0.71, 0.57, 0.08, 0.01), 0.93),
    "hatch": (3.8, 1.7, 0.92, 1.48, 0.8, (0.76, 0.60, 0.12, 0.01), 0.92),
    "suv": (4.55, 1.86, 1.06, 1.72, 1.0, (0.73, 0.61, 0.06, 0.01), 1.06),
    "van": (4.9, 1.95, 1.15, 2.1, 1.02, (0.88, 0.74, 0.01, 0.0), 1.15),
    "pickup": (5.0, 1.88, 1.05, 1.75, 1.0, (0.72, 0.61, 0.42, 0.38), 1.02),
}
_CHOICE = ("car", "car", "hatch", "hatch", "estate", "suv", "suv", "van", "pickup")


def draw_plan(rng: Generator) -> VehiclePlan:
    """A random vehicle."""
    style = str(rng.choice(_CHOICE))
    length, width, belt, roof, bonnet, cabin, tail = _STYLES[style]
    a, b, c, d = rng.uniform(0.96, 1.04, 4)
    return VehiclePlan(
        style, length * a, width * b, belt * c, roof * d, bonnet * c, cabin, tail * c
    )
