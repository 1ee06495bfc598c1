"""XML read by expat into plain elements that know their file and line; no entities, no DTD.

Gazebo reads with tinyxml2, which passes over what is no XML: see ``mended``.
"""

import codecs
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from vrchain.errors import SpecError

MOST_XML_BYTES = 16 << 20
MOST_XML_ELEMENTS = 400_000
MOST_XML_DEPTH = 100

_DECLARATION = re.compile(rb"(\s*)(<\?xml\b[^<>]*\?>)")
_OPAQUE = re.compile(rb"<!--|<!\[CDATA\[")  # what holds no markup
_BARE = re.compile(rb"&(?!(?:lt|gt|amp|quot|apos|#\d{1,7}|#x[0-9a-fA-F]{1,6});)")


@dataclass(eq=False)
class Element:
    """An element of a document: its own text without what surrounds it, and its children."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its attribute of this name, "" if it has none."""
        return self.attributes.get("name", "")

    def find(self, path: str) -> "Element | None":
        """The first child by a tag, or a grandchild by tags with / between them."""
        tag, _, rest = path.partition("/")
        for child in self.all(tag):
            found = child.find(rest) if rest else child
            if found is not None:
                return found
        return None

    def all(self, *tags: str) -> Iterator["Element"]:
        """Every child with one of the tags, in the document's order."""
        return (child for child in self.children if child.tag in tags)

    def words(self, path: str) -> str:
        """The text of a child, "" where there is none."""
        found = self.find(path)
        return "" if found is None else found.text

    def numbers(self, n: int) -> tuple[float, ...]:
        """The element's text as ``n`` finite numbers. Raises SpecError."""
        try:
            values = tuple(float(word) for word in self.text.split())
        except ValueError:
            values = ()
        if len(values) != n or not all(math.isfinite(v) for v in values):
            raise self.error(f"expected {n} finite number{'s' * (n > 1)}, got {self.text[:60]!r}")
        return values

    def number(self, path: str, default: float) -> float:
        """A child's text as one number."""
        return self.values(path, (default,))[0]

    def values(self, path: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """A child's text as so many numbers; ``default`` where there is none or it is empty."""
        found = self.find(path)
        return default if found is None or not found.text else found.numbers(len(default))

    def error(self, what: str) -> SpecError:
        """An error that names the file, the line and the element."""
        return SpecError(f"{self.file}:{self.line}: <{self.tag}>: {what}")


def parse(data: bytes, file: Path) -> Element:
    """The root element of a document. Raises SpecError, with the line, on anything amiss."""
    open_: list[Element] = []
    texts: list[list[str]] = []
    roots: list[Element] = []
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line = parser.CurrentLineNumber
        if count > MOST_XML_ELEMENTS or len(open_) >= MOST_XML_DEPTH:
            raise SpecError(
                f"{file}:{line}: expected at most {MOST_XML_ELEMENTS} elements,"
                f" {MOST_XML_DEPTH} deep: this is more than a world needs"
            )
        element = Element(tag, attributes, file, line)
        (open_[-1].children if open_ else roots).append(element)
        open_.append(element)
        texts.append([])

    def end(_: str) -> None:
        open_.pop().text = "".join(texts.pop()).strip()

    parser = expat.ParserCreate()
    parser.CharacterDataHandler = lambda words: texts[-1].append(words)
    _run(parser, mended(data), file, start, end)
    return roots[0]


def checked(data: bytes, file: Path) -> bytes:
    """A document, mended, for another parser. Raises SpecError.

    It is XML, without a DTD, that is not nested too deep.
    """
    depth = 0
    data = mended(data)

    def start(_: str, __: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_XML_DEPTH:
            raise SpecError(
                f"{file}:{parser.CurrentLineNumber}: elements lie deeper than {MOST_XML_DEPTH}"
            )

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    _run(parser, data, file, start, end)
    return data


def mended(data: bytes) -> bytes:
    """A document as XML, in as many lines, where tinyxml2 asks for less.

    Blanks before its declaration go after it, ``--`` in a comment goes, and an ``&`` that begins no
    reference stands for itself.
    """
    if b"\0" in data[:4]:  # UTF-16
        return data
    data = data.removeprefix(codecs.BOM_UTF8)
    if (found := _DECLARATION.match(data)) is not None:
        data = found[2] + found[1] + data[found.end() :]
    pieces, at = [], 0
    while (opening := _OPAQUE.search(data, at)) is not None:
        pieces.append(_BARE.sub(b"&amp;", data[at : opening.start()]))
        is_comment = opening[0] == b"<!--"
        end = data.find(b"-->" if is_comment else b"]]>", opening.end())
        if end < 0:
            at = opening.start()
            break
        inside = data[opening.end() : end]
        pieces += [opening[0], inside.replace(b"-", b" ") if is_comment else inside]
        pieces.append(data[end : end + 3])
        at = end + 3
    return b"".join([*pieces, _BARE.sub(b"&amp;", data[at:])])


def _run(
    parser: expat.XMLParserType,
    data: bytes,
    file: Path,
    start: Callable[[str, dict[str, str]], None],
    end: Callable[[str], None],
) -> None:
    """Parse a document; its type declaration is refused: entities are declared in it."""

    def refuse(*_: object) -> None:
        raise SpecError(
            f"{file}:{parser.CurrentLineNumber}: <!DOCTYPE> and entities are not read: "
            "take the declaration out of the file"
        )

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise SpecError(f"{file}:{error.lineno}: expected XML, got {reason}") from None
    except (ValueError, LookupError) as error:  # an encoding that Python does not know
        raise SpecError(f"{file}: expected XML in UTF-8: {error}") from None
