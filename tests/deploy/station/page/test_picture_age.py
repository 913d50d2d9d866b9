# SPDX-License-Identifier: MIT
"""How old pictures are is measured from the station to the page, and shown; each is acknowledged."""

from typing import TYPE_CHECKING

import pytest

from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, shows, tells, there

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

SHOWN_AGE = "() => Number(/\\d+/.exec(document.querySelector('#picture-age').textContent)?.[0] ?? NaN)"


def test_each_picture_is_acknowledged_by_its_time(page: "Page", station: FakeStation) -> None:
    there(page, "body[data-fresh=true]")
    begun = len(station.seen)
    station.wait(lambda: len(station.seen) >= begun + 10)
    seen = station.seen[begun:]
    first = station.sent.index(seen[0])
    assert seen == station.sent[first : first + len(seen)]


def test_the_age_includes_the_way(page: "Page", station: FakeStation) -> None:
    page.wait_for_function(f"() => ({SHOWN_AGE})() < 2000")
    station.delay(2.0)
    page.wait_for_function(f"() => ({SHOWN_AGE})() >= 2000")
    assert page.get_attribute("body", "data-fresh") == "true", "it may be so old by what the station says"


def test_pictures_that_come_late_are_no_present(page: "Page", station: FakeStation) -> None:
    page.keyboard.down("ArrowUp")
    shows(page, "#drive-now", "Requesting")
    before = station.sockets
    station.delay(15.0)
    page.wait_for_function(f"() => ({SHOWN_AGE})() >= 15000")
    station.limit_age(10.0)
    shows(page, "#stale", "Slow connection to the base station")
    shows(page, "#stale", "s old, of ")
    tells(page, "#alarm", "connection to the base station")
    there(page, "body[data-fresh=false]")
    shows(page, "#drive-now", "Not driving")
    shows(page, "#commands-reason", "Slow connection to the base station")
    gone(page, "#picture-age")
    assert station.sockets == before
    station.delay(0.0)
    station.go_on()
    there(page, "body[data-fresh=true]")
    gone(page, "#stale")


def test_the_two_clocks_are_compared_by_the_fastest_message(page: "Page") -> None:
    """The page's clock is in ms, the station's in s and of another beginning."""
    ages = page.evaluate(
        """async () => {
        const { PictureAge } = await import("/static/picture_age.js");
        const age = new PictureAge();
        const known = () => [age.isMeasured, age.onTheWayS];
        const ages = [age.ageS(0), ...known()];
        age.arrived(100, 5000, true);
        ages.push(age.ageS(5100), ...known());
        age.heard({ time_s: 100, at_s: 100.25 });
        ages.push(age.ageS(5100), ...known());
        age.arrived(101, 6000, false);
        age.heard({ time_s: 101, at_s: 101.05 });
        ages.push(age.ageS(6100), ...known());
        age.arrived(102, 7000, false);
        age.heard({ time_s: 102, at_s: 104 });
        ages.push(age.ageS(7100), ...known());
        age.arrived(200, 8000, false);
        ages.push(age.ageS(8100), ...known());
        return ages; }"""
    )
    assert ages == [
        *(None, False, 0),
        *(pytest.approx(0.1), False, 0),  # it arrived 0.1 s ago; how long it was on the way is not known yet
        *(pytest.approx(0.35), True, pytest.approx(0.25)),
        *(pytest.approx(0.15), True, pytest.approx(0.05)),
        *(pytest.approx(0.15), True, pytest.approx(0.05)),  # a slow answer tells nothing new
        *(pytest.approx(0.1), False, 0),  # of the future: one of the clocks stood still meanwhile
    ]
