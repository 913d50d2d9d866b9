# SPDX-License-Identifier: MIT
"""The report of pictures: the film in its order, then the states."""

from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest

from tests.deploy.station.album import album
from tests.deploy.station.film import Film, read_film

if TYPE_CHECKING:
    from playwright.sync_api import Page


class FakePage:
    """Whose pictures are a text."""

    def screenshot(self, *, path: Path) -> None:
        path.write_bytes(b"png")


def test_film_comes_first_in_its_order_and_each_state_once(tmp_path: Path) -> None:
    film = Film(tmp_path, 0.0)
    for name, caption in (("open", "It <opens>"), ("cut", "The cable is cut")):
        film.take(cast("Page", FakePage()), name, caption)
    for name in ("armed-phone-light", "armed-landscape-dark", "armed-desktop-light", "stack-lost"):
        (tmp_path / f"{name}.png").write_bytes(b"png")
    text = album(tmp_path)
    assert [shot.file for shot in read_film(tmp_path)] == ["film-01-open.png", "film-02-cut.png"]
    order = [
        "The first minutes of the demo",
        "It &lt;opens&gt;",
        "The cable is cut",
        "<h2>armed</h2>",
        "<h2>stack-lost</h2>",
    ]
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    assert text.count("<img") == 6
    assert text.count("<h2>") == 3


def test_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no pictures"):
        album(tmp_path)


def test_film_without_a_folder_takes_no_pictures() -> None:
    film = Film(None, 0.0)
    film.take(cast("Page", None), "open", "It opens")
    assert [shot.caption for shot in film.shots] == ["It opens"]
