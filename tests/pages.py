"""What is in a page: the documents it frames, and what it would fetch when it is opened."""

import re
from html.parser import HTMLParser

_OWN = ("data:", "blob:", "#", "about:")
_IN_CODE = re.compile(
    r"""(?:import\s*\(?|from\s|url\(|@import\s)\s*["'`]?((?:https?:)?//[^"'`)\s]+)"""
)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.framed: list[str] = []
        self._code = False

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attributes}
        self._code = tag in ("script", "style")
        links = [given.get("src", ""), given.get("data", "") if tag == "object" else ""]
        links += [given.get("href", "")] if tag == "link" else []
        self.found += [link for link in links if link and not link.startswith(_OWN)]
        if "srcdoc" in given:
            self.framed.append(given["srcdoc"])
            self.found += fetched(given["srcdoc"])

    def handle_endtag(self, tag: str) -> None:
        self._code = False

    def handle_data(self, data: str) -> None:
        if self._code:
            self.found += _IN_CODE.findall(data)


def frames(page: str) -> list[str]:
    """The documents that a page holds in frames."""
    reader = _Reader()
    reader.feed(page)
    return reader.framed


def fetched(page: str) -> list[str]:
    """Addresses that a browser would load by itself to show a page, documents inside it too."""
    reader = _Reader()
    reader.feed(page)
    return reader.found
