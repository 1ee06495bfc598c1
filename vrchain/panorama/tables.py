"""Files of an image database: text, tables, and names that stay in the folder."""

import csv
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import yaml

from vrchain.errors import ImageError
from vrchain.panorama.codec import read_content


def read_text(file: Path) -> str:
    """A text file of a database. ImageError: unreadable, no UTF-8, or a Git LFS pointer."""
    try:
        return read_content(file).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ImageError(f"{file}: expected text in UTF-8 ({error})") from error


def rows_of(table: Path, needed: tuple[str, ...]) -> Iterator[tuple[dict[str, str], str]]:
    """Rows by column, blanks around cells cut off, and where each is; empty lines are left out."""
    reader = csv.reader(read_text(table).splitlines())
    try:
        columns = [name.strip() for name in next(reader, [])]
        missing = [name for name in needed if name not in columns]
        if missing:
            raise ImageError(
                f"{table}: expected the columns {', '.join(needed)}, found no "
                f"{', '.join(missing)} among {', '.join(columns) or 'none'}"
            )
        for cells in reader:
            where = f"{table}, line {reader.line_num}"
            if not any(map(str.strip, cells)):
                continue
            if len(cells) != len(columns):
                raise ImageError(f"{where}: expected {len(columns)} cells, got {len(cells)}")
            yield dict(zip(columns, map(str.strip, cells), strict=True)), where
    except csv.Error as error:
        raise ImageError(f"{table}, line {reader.line_num}: no CSV ({error})") from error


def number(row: Mapping[str, str], column: str, where: str) -> float:
    value = maybe(row, column, where)
    if value is None:
        raise ImageError(f"{where}: expected a number as {column}, got nothing: leave the row out")
    return value


def maybe(row: Mapping[str, str], column: str, where: str) -> float | None:
    """None where the column or the number is missing, as NaN says too."""
    cell = row.get(column, "")
    try:
        value = float(cell or "nan")
    except ValueError:
        value = math.inf
    if math.isinf(value) or abs(value) > 1e9:
        raise ImageError(f"{where}: expected a number as {column}, got {cell!r}: mend the row")
    return None if math.isnan(value) else value


def inside(folder: Path, name: str, where: str) -> Path:
    """The file of this name in the folder. Names from elsewhere are not followed out of it."""
    parts = PurePosixPath(name).parts
    drive = PureWindowsPath(name).drive
    if not parts or PurePosixPath(name).is_absolute() or drive or ".." in parts or "\0" in name:
        raise ImageError(f"{where}: expected a file's name within the folder, got {name!r}")
    return folder / name


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object. ImageError: it is another file."""
    try:
        told = json.loads(read_text(file))
        if not isinstance(told, dict):
            raise ValueError("no object")
        return told
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{file}: expected a JSON object ({error})") from error


def read_yaml(file: Path) -> dict[str, Any]:
    """A table in OpenCV's YAML, whose first line is none."""
    lines = read_text(file).splitlines()
    try:
        told = yaml.safe_load("\n".join(line for line in lines if not line.startswith("%")))
        if not isinstance(told, dict):
            raise ValueError("no table")
        return told
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ImageError(f"{file}: expected a table in YAML ({error})") from error
