"""Claims and pairs made up for tables: rows as ``landmarks.precision.evaluate`` has them."""


def claim(suburb: int, pair: int, score: float, right: bool = True, **others: object) -> dict:
    return {
        "suburb": suburb, "pair": pair, "variant": "sift", "score": score, "right": right,
        "shared": right, "twin": False, "duplicate": False, "quality_m": 1.0 if right else 9.0,
        "support": 7, "object_a": "a", "object_b": "b", **others,
    }  # fmt: skip


def pair(
    suburb: int, number: int, co_visible: int = 4, error_deg: float = 1.0, **others: object
) -> dict:
    return {
        "suburb": suburb, "pair": number, "variant": "sift", "claimed": 0.5, "surest": 0.5,
        "spacing_m": 5.0, "co_visible": co_visible, "ms": 10.0, "direction_error_deg": error_deg,
        "heading_error_deg": error_deg, **others,
    }  # fmt: skip
