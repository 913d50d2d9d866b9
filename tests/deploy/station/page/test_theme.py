# SPDX-License-Identifier: MIT
"""Both themes can be read: the contrast of each pair of colours, computed (WCAG 2.2, 1.4.3 and 1.4.11)."""

import re
from pathlib import Path

import pytest

THEME = Path(__file__).parents[4] / "deploy" / "station" / "page" / "theme.css"
TEXT = 4.5
GRAPHIC = 3.0
PAIRS = [
    *(
        (colour, ground, TEXT)
        for colour in ("text", "muted", "accent", "ok", "warning", "danger")
        for ground in ("panel", "page")
    ),
    *((colour, "sunk", TEXT) for colour in ("text", "muted")),
    *(("on-mode", mode, TEXT) for mode in ("disarmed", "armed", "hold", "fault", "lost")),
    ("text", "accent-soft", TEXT),
    ("muted", "accent-soft", TEXT),
    ("on-accent", "accent", TEXT),
    ("on-notice", "notice", TEXT),
    ("on-stop", "stop", TEXT),
    ("on-stop", "stop-held", TEXT),
    ("on-banner", "banner", TEXT),
    *((graphic, "panel", GRAPHIC) for graphic in ("edge", "focus", "stop", "plot-1", "plot-2")),
    ("focus", "page", GRAPHIC),
]


def _themes() -> dict[str, dict[str, str]]:
    light, dark = THEME.read_text(encoding="utf-8").split("@media (prefers-color-scheme: dark)")
    found = [dict(re.findall(r"--([\w-]+):\s*(#[0-9a-f]{6});", text)) for text in (light, dark)]
    return {"light": found[0], "dark": found[1]}


def _luminance(colour: str) -> float:
    channels = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(one: str, other: str) -> float:
    darker, lighter = sorted((_luminance(one), _luminance(other)))
    return (lighter + 0.05) / (darker + 0.05)


def test_the_measure_is_that_of_wcag() -> None:
    assert _contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert _contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize(("colour", "ground", "least"), PAIRS)
def test_colour_pair_is_distinguishable(theme: str, colour: str, ground: str, least: float) -> None:
    colours = _themes()[theme]
    assert _contrast(colours[colour], colours[ground]) >= least


def test_both_themes_have_the_same_names() -> None:
    themes = _themes()
    assert themes["light"].keys() == themes["dark"].keys()
    assert len(themes["light"]) > 25


def test_no_colour_stands_anywhere_else() -> None:
    style = "".join((THEME.parent / name).read_text(encoding="utf-8") for name in ("style.css", "log.css"))
    assert re.findall(r"#[0-9a-fA-F]{3,8}\b(?=[;\s,)])", style) == []
    used = set(re.findall(r"var\(--([\w-]+)\)", style))
    assert used - {"mode", "check"} <= _themes()["light"].keys()
