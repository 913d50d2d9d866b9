# SPDX-License-Identifier: MIT
"""Writes the screenshots of a test run as one page: `python tests/deploy/station/album.py FOLDER`."""

import base64
import sys
from collections import defaultdict
from html import escape
from pathlib import Path

from segway_ecc.hil.page import page, section

sys.path.insert(0, str(Path(__file__).parents[3]))  # run as a script, it is in no package
from tests.deploy.station.film import read_film

SIZES = ("phone", "landscape", "desktop")
STYLE = "max-width: 100%; vertical-align: top; margin: 0.5em 0; border: 1px solid gray"


def album(folder: Path) -> str:
    """The page: the film of the demo, then the states, with a picture of each size and theme.

    Raises:
        FileNotFoundError: There is no picture.
    """
    film = read_film(folder)
    states: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.glob("*.png")):
        if path.name not in {shot.file for shot in film}:
            states[_state(path)].append(path)
    if not states and not film:
        raise FileNotFoundError(f"no pictures in {folder}")
    introduction = (
        "As headless Chromium showed it in the tests. The film is that of `segway-ecc demo`. What begins with stack is "
        "the whole stack over ROS 2: the node, the plant and the base station as processes of their own; the others "
        "are shown a fake station."
    )
    strip = "".join(_picture(folder / shot.file, f"{shot.at_s:.0f} s: {shot.caption}") for shot in film)
    sections = [section("The first minutes of the demo, every fault, and its log", strip)] if film else []
    sections += [section(state, "".join(_picture(path) for path in paths)) for state, paths in states.items()]
    return page("The base station's page in its main states", introduction, sections)


def _state(path: Path) -> str:
    """What a picture shows, by the part of its name before the size."""
    return next((path.stem.split(f"-{size}")[0] for size in SIZES if f"-{size}" in path.stem), path.stem)


def _picture(path: Path, caption: str = "") -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    name = escape(caption or path.stem)
    return f'<p>{name}<br><img alt="{name}" style="{STYLE}" src="data:image/png;base64,{data}"></p>\n'


if __name__ == "__main__":
    target = Path(sys.argv[1], "report.html")
    target.write_text(album(Path(sys.argv[1])), encoding="utf-8")
    sys.stdout.write(f"report: {target}\n")
