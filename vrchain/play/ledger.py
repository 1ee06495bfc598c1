"""Change any byte of a ledger, and see at once what everybody says who looks at it."""

from functools import partial
from pathlib import Path

from matplotlib.axes import Axes

from vrchain.experiments.ledger.tampering import change_byte, stored, who_notices
from vrchain.ledger import Ledger
from vrchain.play.controls import WIDTH_IN, Choice, Play, Shown, Slider
from vrchain.plots.style import GREY, RED, panels

_NOTHING = "nothing"
_ROWS, _COLUMNS = 7, 16  # of the bytes that are shown


def tamper(folder: str | Path) -> Play:
    """A ledger of which one bit may be turned over, in a copy; who notices, and what they say.

    NotALedgerError where there is none.
    """
    home = Path(folder)
    parts = stored(home)
    with Ledger.open(home) as ledger:
        heights = [entry.block.height for entry in ledger.entries()]

    def draw(part: str, byte: int, bit: int) -> Shown:
        figure, (chain, hexes) = panels(WIDTH_IN, 4.4, 2, 1, height_ratios=[1, 3])
        touched = parts.get(part)
        _draw_chain(chain, heights, None if touched is None else touched.height)
        hexes.set_axis_off()
        if touched is None:
            says = "Nobody touches anything. Choose what to change."
            hexes.text(0.5, 0.5, "here its bytes are shown", ha="center", color=GREY)
            return Shown(says, figure, who_notices(home, lambda copy: None), {"byte": 0})
        byte = min(int(byte), len(touched.data) - 1)  # of the part chosen before
        table = who_notices(home, partial(change_byte, name=part, at=byte, bit=bit))
        _draw_bytes(hexes, touched.data, byte, bit)
        noticed = int((~table.says.str.startswith("nothing")).sum())
        says = (
            f"Bit {bit} of byte {byte} of {len(touched.data)}, in {part}: "
            f"**{noticed} of {len(table)} notice**."
        )
        return Shown(says, figure, table, {"byte": len(touched.data) - 1})

    longest = max(len(part.data) for part in parts.values())
    return Play(
        draw,
        {
            "part": Choice("change", (_NOTHING, *parts), _NOTHING),
            "byte": Slider("the byte", 0, longest - 1, 1, 0),
            "bit": Slider("the bit", 0, 7, 1, 0),
        },
    )


def _draw_chain(axes: Axes, heights: list[int], touched: int | None) -> None:
    """Blocks from left to right, each on the hash of the one before; the changed one in red."""
    for height in heights:
        changed = height == touched
        axes.text(
            height, 0, f"block {height}", ha="center", va="center", fontsize=9,
            color="white" if changed else "black",
            bbox={"boxstyle": "square,pad=0.5", "fc": RED if changed else "#f6f6f2", "ec": GREY},
        )  # fmt: skip
    axes.set(xlim=(-0.6, len(heights) - 0.4), ylim=(-1, 1))
    axes.set_axis_off()


def _draw_bytes(axes: Axes, data: bytes, at: int, bit: int) -> None:
    """The bytes around the changed one, which is shown as it was and as it is."""
    first = max(0, at // _COLUMNS - _ROWS // 2)
    for row in range(first, first + _ROWS):
        y = first - row
        own = data[row * _COLUMNS : (row + 1) * _COLUMNS]
        if own:
            axes.text(-1.2, y, f"{row * _COLUMNS}", ha="right", fontsize=9, color=GREY)
        for column, value in enumerate(own):
            changed = row * _COLUMNS + column == at
            text = f"{value:02x}→{value ^ 1 << bit:02x}" if changed else f"{value:02x}"
            axes.text(
                column, y, text, ha="center", fontsize=9, family="monospace",
                color=RED if changed else "black", fontweight="bold" if changed else "normal",
            )  # fmt: skip
    axes.set(xlim=(-2.5, _COLUMNS), ylim=(-_ROWS, 1))
