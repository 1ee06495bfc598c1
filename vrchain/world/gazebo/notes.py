"""What of a world is not supported: collected while it is read, told in one warning."""

from collections import Counter


class Notes:
    """Kinds of things left out or simplified, each with the names of what it concerns."""

    def __init__(self) -> None:
        self._found: dict[str, Counter[str]] = {}

    def add(self, kind: str, name: str = "") -> None:
        """One more of a kind, such as "plugins"."""
        self._found.setdefault(kind, Counter())[name] += 1

    def __bool__(self) -> bool:
        return bool(self._found)

    def __str__(self) -> str:
        return "; ".join(_line(kind, names) for kind, names in sorted(self._found.items()))


def _line(kind: str, names: Counter[str], most: int = 4) -> str:
    """A kind, how often, and the first names."""
    named = [" ".join(name.split())[:60] for name in names if name]
    told = ", ".join(named[:most]) + (", ..." if len(named) > most else "")
    count = sum(names.values())
    return f"{kind}: {count}" + (f" ({told})" if told else "")
