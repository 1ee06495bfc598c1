"""To play with: pictures that answer to controls, each one call, ``vr.play.NAME(...)``.

Each is a function from the values of its controls to a sentence, a picture and a table. A notebook
shows that with controls where ipywidgets is installed, and without them elsewhere; what is shown is
an ordinary output, which stays when the kernel is gone.
"""

from typing import TYPE_CHECKING

from vrchain.lazy import lazy

if TYPE_CHECKING:
    from vrchain.play.controls import Play as Play
    from vrchain.play.curves import threshold as threshold
    from vrchain.play.driving import drive as drive
    from vrchain.play.home import homing as homing
    from vrchain.play.ledger import tamper as tamper
    from vrchain.play.machines import machines as machines
    from vrchain.play.missions import replay as replay
    from vrchain.play.pairs import apart as apart
    from vrchain.play.teams import team as team

_HOMES = {
    "Play": "controls",
    "apart": "pairs",
    "drive": "driving",
    "homing": "home",
    "machines": "machines",
    "replay": "missions",
    "tamper": "ledger",
    "team": "teams",
    "threshold": "curves",
}
__all__ = list(_HOMES)
if not TYPE_CHECKING:  # or every name would be known
    __getattr__, __dir__ = lazy(__name__, _HOMES)
