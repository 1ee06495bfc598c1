"""A building while it is built: what its walls and roofs are added to, and share."""

from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings.roofs import Roof
from vrchain.world.shapes import Model, Part, box
from vrchain.world.textures import Colour

_TAR_RGB = (95.0, 95.0, 100.0)


class Shell:
    """The model under construction, its random generator, and the look of its roofs.

    trim, soffit: patches of edge boards, and of what is seen of a roof from below.
    """

    roofing: textures.Material
    roof_rgb: Colour
    trim: int
    soffit: int
    soffit_shade = 0.6

    def __init__(self, rng: Generator) -> None:
        self.rng, self.model = rng, Model()

    def cover(self, roof: Roof, px_per_m: float = 18.0) -> None:
        """Add a roof, its texture drawn to scale."""
        shape = (max(8, int(roof.slope_m * px_per_m)), max(8, int(roof.length_m * px_per_m)))
        self.model.add(roof.cover, self.roofing(self.rng, shape, self.roof_rgb, px_per_m))
        self.model.add(roof.soffit, self.soffit, self.soffit_shade)
        self.model.add(roof.fascia, self.trim)

    def flat_roof(self, low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
        """Add tar between two corners, and trim around and under it."""
        tar = self.model.patch(textures.plain(self.rng, _TAR_RGB, (64, 64), 0.15))
        self.model.add(box(low, high, top=False, bottom=True), self.trim)
        self.model.add(box(low, high, sides=""), tar)

    def plain(self, part: Part, shade: float = 1.0) -> None:
        """Add a part in the trim's colour."""
        self.model.add(part, self.trim, shade)
