# SPDX-License-Identifier: MIT
"""The report in a browser: at the width of a small screen no column is clipped and nothing has to be scrolled."""

from pathlib import Path

import pytest

from segway_ecc.hil.case_study.report import render
from segway_ecc.hil.case_study.study import Seat
from tests.chromium import chromium
from tests.hil.case_study.test_report import study_of

pytestmark = pytest.mark.browser

CLIPPED = """() => [document.documentElement, ...document.querySelectorAll(".wide")]
    .filter((part) => part.scrollWidth > part.clientWidth)
    .map((part) => [part.getAttribute("aria-label"), part.scrollWidth, part.clientWidth])"""


def test_at_1280_pixels_beside_a_scroll_bar_every_column_of_every_seat_is_in_view(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text(render(study_of(*Seat)), "utf-8")
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1265, "height": 800})
        page.goto(report.as_uri())
        columns = page.locator("tbody tr").first.locator("th, td").count()
        clipped = page.evaluate(CLIPPED)

    assert columns == 4 + len(Seat) + 1 + len(Seat)
    assert clipped == []
