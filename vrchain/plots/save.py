"""Figures to files, the same bytes for the same figure: PNG for screens, PDF for print."""

import io
from pathlib import Path

import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from vrchain.files import write_file
from vrchain.plots.column import lay_out_for_print

_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG."""
    return _render(figure, "png")


def save_figure(figure: Figure, table: pd.DataFrame, path_without_ending: Path) -> None:
    """Write a figure as PNG and PDF and what it shows as CSV: all three or none.

    The PDF is laid out for print (see ``column``), and so is the figure from then on.
    """
    contents = {"png": _smaller(_render(figure, "png"))}
    lay_out_for_print(figure)
    contents["pdf"] = _render(figure, "pdf")
    contents["csv"] = table.to_csv(index=False).encode()
    written: list[Path] = []
    try:
        for kind, content in contents.items():
            path = path_without_ending.with_suffix(f".{kind}")
            write_file(path, content)
            written.append(path)
    except BaseException:
        for path in written:
            path.unlink(missing_ok=True)
        raise


def _smaller(png: bytes) -> bytes:
    """The same picture in 256 colours of its own: a third of the bytes."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(png)) as picture:
        picture.convert("RGB").quantize(256).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _render(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    dated = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    with rc_context({"pdf.fonttype": 42}):  # text that can be found, copied and edited
        figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dated)
    return buffer.getvalue()
