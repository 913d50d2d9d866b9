"""The page."""

import importlib.resources
from collections.abc import Iterator, Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final, NamedTuple

_TYPES: Final = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/vnd.microsoft.icon",
    ".woff2": "font/woff2",
    ".txt": "text/plain",
    "": "text/plain",
}
_TEXT: Final = ("text/", "image/svg")


class PageFile(NamedTuple):
    """A file of the page.

    Attributes:
        content: Its bytes.
        kind: Its MIME type.
    """

    content: bytes
    kind: str


def page_files() -> Mapping[str, PageFile]:
    """Every file of the page by its path; what is not among them cannot be asked for, whatever path is given."""
    folder = importlib.resources.files("segway_ecc.deploy.station") / "page"
    return dict(_page_files(folder, ""))


def _page_files(folder: Traversable, prefix: str) -> Iterator[tuple[str, PageFile]]:
    for item in folder.iterdir():
        path = f"{prefix}{item.name}"
        kind = _TYPES.get(Path(item.name).suffix)
        if item.is_dir():
            yield from _page_files(item, f"{path}/")
        elif kind is not None and not item.name.startswith("."):
            yield path, PageFile(item.read_bytes(), kind)


def charset(kind: str) -> str | None:
    """What text is written in."""
    return "utf-8" if kind.startswith(_TEXT) else None
