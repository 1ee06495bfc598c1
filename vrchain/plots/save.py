"""Figures to bytes and files, the same bytes for the same figure."""

import io
from pathlib import Path

from matplotlib.figure import Figure

from vrchain.files import write_file

_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG."""
    return _render(figure, "png")


def save_figure(figure: Figure, path_without_ending: Path) -> None:
    """Write the figure as PNG and PDF."""
    for kind in ("png", "pdf"):
        write_file(path_without_ending.with_suffix(f".{kind}"), _render(figure, kind))


def _render(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    dated = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    figure.savefig(buffer, format=kind, dpi=_DPI, metadata=dated)
    return buffer.getvalue()
