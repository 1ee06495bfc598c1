"""The errors a caller may see; each says what was expected, what came, and how to mend it."""


def printable(text: str) -> str:
    """The text with all that shows as nothing, moves the cursor or turns the line spelt out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class VRChainError(Exception):
    """Base of every error that this library raises on purpose. It reads as one line."""

    def __str__(self) -> str:
        return printable(" ".join(super().__str__().splitlines()))


class SeedError(VRChainError):
    """A seed is no whole number."""


class SpecError(VRChainError):
    """A scene file is missing, unreadable, or holds a key or value that is not allowed."""


class UnsupportedWarning(UserWarning):
    """Something in a world from elsewhere is left out or simplified; the message lists what."""


class PoseError(VRChainError):
    """A pose lies off the map or inside an object."""


class ImageError(VRChainError):
    """A file is not a readable image, or an image cannot serve (blank, too small)."""


class RenderError(VRChainError):
    """The renderer cannot work here, for instance because system libraries are missing."""


class OutputError(VRChainError):
    """A result cannot be written: no room, no permission, or something is in the way."""


class LearnedError(VRChainError):
    """Learned features cannot be had: torch or the weights are not installed."""


class MissionError(VRChainError):
    """A mission cannot be set up: no such robot or goal, or no place for the team."""


class BagError(VRChainError):
    """A bag cannot be read, or a robot in it lacks what a panorama needs."""


class WorkerError(VRChainError):
    """One of several processes that share out work was ended."""


class LedgerError(VRChainError):
    """Base of the ledger's own errors."""
