"""What a season does to the colours of leaves and grass; shapes and places stay."""

import colorsys

from vrchain.world.textures import Colour, hsv


def leaf(colour: Colour, season: str, *, evergreen: bool) -> Colour:
    """The colour in ``season`` of leaves that have ``colour`` in summer.

    Every plant keeps its place among the others: what is yellower in summer turns yellower.
    """
    hue, saturation, value = _parts(colour)
    red = not 45 < hue < 175  # a copper beech, a cherry
    if season == "summer":
        return colour
    if evergreen:
        return hsv(hue, saturation * (0.9 if season == "winter" else 1.0), value)
    if season == "spring":
        if red:  # in blossom
            return hsv(322 + hue % 30, 0.4 * saturation, 0.7 + 0.4 * value)
        return hsv(hue - 0.2 * (hue - 62), saturation, 1.15 * value)
    if season == "autumn":
        turned = 0.2 * hue if hue < 45 else 352.0 if red else 14 + 0.6 * (hue - 50)
        return hsv(turned, 0.45 + 0.5 * saturation, 0.3 + 0.75 * value)
    return hsv(30 + 0.04 * hue, 0.12 + 0.3 * saturation, 0.25 + 0.45 * value)


def blooms(season: str) -> bool:
    """Whether shrubs and hedges have flowers."""
    return season in ("spring", "summer")


def grass(colour: Colour, season: str) -> Colour:
    """The colour in ``season`` of grass that has ``colour`` in summer."""
    hue, saturation, value = _parts(colour)
    turned_deg, paler, lighter = {
        "summer": (0.0, 1.0, 1.0),
        "spring": (8.0, 1.15, 1.06),
        "autumn": (-16.0, 0.95, 0.95),
        "winter": (-26.0, 0.62, 0.9),
    }[season]
    return hsv(hue + turned_deg, paler * saturation, lighter * value)


def _parts(colour: Colour) -> tuple[float, float, float]:
    """Hue in degrees, saturation and value in 0..1."""
    hue, saturation, value = colorsys.rgb_to_hsv(*(c / 255 for c in colour))
    return 360 * hue, saturation, value
