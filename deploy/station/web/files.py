# SPDX-License-Identifier: MIT
"""The page's files."""

import importlib.resources
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


class PageFile(NamedTuple):
    """A file of the page.

    Attributes:
        content: Its bytes.
        kind: Its MIME type.
    """

    content: bytes
    kind: str

    @property
    def charset(self) -> str | None:
        """The encoding of a text; None for binary content."""
        return "utf-8" if self.kind.startswith(("text/", "image/svg")) else None


def page_files(folder: Traversable | None = None, prefix: str = "") -> dict[str, PageFile]:
    """Every file of the page by its path; nothing else can be requested, whatever path is given."""
    found: dict[str, PageFile] = {}
    for item in (folder or importlib.resources.files("segway_ecc.deploy.station") / "page").iterdir():
        path = f"{prefix}{item.name}"
        kind = _TYPES.get(Path(item.name).suffix)
        if item.is_dir():
            found |= page_files(item, f"{path}/")
        elif kind is not None and not item.name.startswith("."):
            found[path] = PageFile(item.read_bytes(), kind)
    return found
