"""Figures to bytes and files, the same bytes for the same figure."""

import io
from pathlib import Path

import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from vrchain.files import write_file

_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG."""
    return _render(figure, "png")


def save_figure(figure: Figure, table: pd.DataFrame, path_without_ending: Path) -> None:
    """Write a figure as PNG and PDF and what it shows as CSV: all three or none."""
    contents = {kind: _render(figure, kind) for kind in ("png", "pdf")}
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


def _render(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    dated = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    with rc_context({"pdf.fonttype": 42}):  # text that can be found, copied and edited
        figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dated)
    return buffer.getvalue()
