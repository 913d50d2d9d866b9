# SPDX-License-Identifier: MIT
"""Writes the screenshots of a test run as one page: `python tests/deploy/station/album.py FOLDER`."""

import base64
import sys
from collections import defaultdict
from html import escape
from pathlib import Path

from segway_ecc.hil.page import page, section

SIZES = ("phone", "desktop")
STYLE = "max-width: 100%; vertical-align: top; margin: 0.5em 0; border: 1px solid gray"


def album(folder: Path) -> str:
    """The page; its sections are the states, with a picture of each size and theme.

    Raises:
        FileNotFoundError: There is no picture.
    """
    states: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.glob("*.png")):
        states[next(path.stem.split(f"-{size}")[0] for size in SIZES if f"-{size}" in path.stem)].append(path)
    if not states:
        raise FileNotFoundError(f"no pictures in {folder}")
    introduction = (
        "As headless Chromium showed it in the tests. What begins with stack is the whole stack over ROS 2: the node, "
        "the plant and the base station as processes of their own; the others are shown a fake station."
    )
    sections = [section(state, "".join(map(_picture, paths))) for state, paths in states.items()]
    return page("The base station's page in its main states", introduction, sections)


def _picture(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    name = escape(path.stem)
    return f'<p>{name}<br><img alt="{name}" style="{STYLE}" src="data:image/png;base64,{data}"></p>\n'


if __name__ == "__main__":
    target = Path(sys.argv[1], "report.html")
    target.write_text(album(Path(sys.argv[1])), encoding="utf-8")
    sys.stdout.write(f"report: {target}\n")
