# SPDX-License-Identifier: MIT
"""A film strip: pictures of a page in the order in which they were taken, each with what it shows and when."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from playwright.sync_api import Page

INDEX: Final = "film.json"
"""The file that names the pictures, in their order."""


class Shot(NamedTuple):
    """A picture of the film: its file, what it shows, and when it was taken, s since the beginning."""

    file: str
    caption: str
    at_s: float


class Film:
    """Takes the pictures into a folder; with none it takes none."""

    def __init__(self, folder: Path | None, begun_s: float) -> None:
        """Begin a film at a time, monotonic, s."""
        self._folder = folder
        self._begun_s = begun_s
        self.shots: list[Shot] = []

    def take(self, page: "Page", name: str, caption: str) -> None:
        """Take a picture of what is in sight."""
        shot = Shot(f"film-{len(self.shots) + 1:02d}-{name}.png", caption, round(time.monotonic() - self._begun_s, 1))
        self.shots.append(shot)
        if self._folder is not None:
            page.screenshot(path=self._folder / shot.file)
            (self._folder / INDEX).write_text(json.dumps(self.shots), encoding="utf-8")


def read_film(folder: Path) -> list[Shot]:
    """The pictures of a folder, in their order; none where no film was made."""
    index = folder / INDEX
    return [Shot(*shot) for shot in json.loads(index.read_text(encoding="utf-8"))] if index.is_file() else []
