# SPDX-License-Identifier: MIT
"""Never a frozen picture that looks alive; and the page comes back by itself."""

from typing import TYPE_CHECKING

import pytest

from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import drawn, gone, shows, tells, there

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser


def _shut(station: FakeStation) -> None:
    station.script.accepts = False
    station.cut()


TROUBLE = {
    "no picture comes": FakeStation.fall_silent,
    "its time stands still": FakeStation.stand_still,
    "the socket is closed": _shut,
}


@pytest.mark.variants(1)
@pytest.mark.parametrize("trouble", TROUBLE)
def test_stale_picture_is_reported_and_greyed(page: "Page", station: FakeStation, trouble: str) -> None:
    gone(page, "#stale")
    there(page, "#plots[data-newest]")
    TROUBLE[trouble](station)
    shows(page, "#stale", "No connection to the base station")
    shows(page, "#stale", "s old")
    tells(page, "#alarm", "No connection to the base station")
    box = page.locator("#stale").bounding_box()
    assert box is not None
    assert box["width"] == 1280
    for panel in ("#summary", "#overview", ".fleet", "#plots", ".checklist"):
        style = page.eval_on_selector(panel, "element => getComputedStyle(element).filter")
        assert style == "grayscale(1)", panel
    assert page.get_attribute("#plots", "data-live") == "false"
    shows(page, "#plots-state", "stopped")
    shows(page, "#commands-reason", "No connection to the base station")
    drawn(page)
    newest = page.get_attribute("#plots", "data-newest")
    station.wait_frames(6)
    assert page.get_attribute("#plots", "data-newest") == newest


def test_stale_banner_shows_growing_age_and_stays_visible(page: "Page", station: FakeStation) -> None:
    station.fall_silent()
    there(page, "#stale:not([hidden])")
    page.evaluate("() => scrollTo(0, document.body.scrollHeight)")
    page.wait_for_function(
        "() => Number(/is ([\\d.]+) s old/.exec(document.querySelector('#stale-age').textContent)?.[1]) > 2"
    )
    page.wait_for_function(
        "() => / old, of \\d\\d:\\d\\d:\\d\\d$/.test(document.querySelector('#stale-age').textContent)"
    )
    box = page.locator("#stale").bounding_box()
    assert box is not None
    assert box["y"] == 0


def test_a_picture_that_still_stands_after_a_new_socket_is_not_taken_for_a_new_one(
    page: "Page", station: FakeStation
) -> None:
    station.stand_still()
    there(page, "body[data-fresh=false]")
    page.evaluate(
        """() => { window.fresh = 0; new MutationObserver(() => { window.fresh += 1; })
        .observe(document.body, {attributes: true, attributeFilter: ["data-fresh"]}); }"""
    )
    station.reconnect()
    station.wait_frames(5)
    assert page.evaluate("() => window.fresh") == 0
    station.go_on()
    there(page, "body[data-fresh=true]")


def test_it_comes_back_by_itself(page: "Page", station: FakeStation) -> None:
    before = station.sockets
    _shut(station)
    there(page, "#stale:not([hidden])")
    station.wait_frames(30)
    station.script.accepts = True
    there(page, "body[data-fresh=true]")
    gone(page, "#stale")
    shows(page, "#mode", "ARMED")
    there(page, "#plots[data-live=true]")
    assert station.sockets == before + 1


def test_silent_socket_is_closed(page: "Page", station: FakeStation) -> None:
    """TCP may take minutes to notice; the page does not wait for it."""
    before = station.sockets
    station.fall_silent()
    station.wait(lambda: station.sockets > before)
    station.go_on()
    there(page, "body[data-fresh=true]")


def test_each_try_waits_longer(page: "Page", station: FakeStation) -> None:
    page.evaluate("""() => { window.waits = []; const real = setTimeout;
        window.setTimeout = (work, wait) => {
            if (wait >= 250 && wait <= 5000) window.waits.push(wait);
            return real(work, wait / 20); }; }""")
    _shut(station)
    page.wait_for_function("() => window.waits.length >= 7")
    assert page.evaluate("() => window.waits.slice(0, 7)") == [250, 500, 1000, 2000, 4000, 5000, 5000]
    station.script.accepts = True
    there(page, "body[data-fresh=true]")
    page.evaluate("() => { window.waits = []; }")
    _shut(station)
    page.wait_for_function("() => window.waits.length >= 1")
    assert page.evaluate("() => window.waits[0]") == 250


def test_a_station_that_began_anew_is_believed(page: "Page", station: FakeStation) -> None:
    """Its clock may stand before the old one's."""
    there(page, "#plots[data-newest]")
    station._time_s = 5.0
    station.reconnect()
    there(page, "body[data-fresh=true]")
    page.wait_for_function("() => Number(document.querySelector('#plots').dataset.newest) < 100")


def test_messages_are_taken_in_the_order_in_which_they_were_sent(page: "Page") -> None:
    """A picture has to be inflated first; what was sent after it, the end of the socket too, waits for that."""
    kinds = page.evaluate(
        """async () => {
        const { Connection } = await import("/static/connection.js");
        const real = window.WebSocket;
        let socket;
        window.WebSocket = class {
          static OPEN = 1;
          readyState = 1;
          constructor() { socket = this; }
          send() {}
          close() {}
        };
        const kinds = [];
        let isOver;
        const over = new Promise((resolve) => { isOver = resolve; });
        const closed = () => { kinds.push("closed"); isOver(); };
        const connection = new Connection("ws://a", {message: (kind) => kinds.push(kind), change() {}, closed});
        connection.open();
        window.WebSocket = real;
        const deflate = (text) => new Response(
          new Blob([text]).stream().pipeThrough(new CompressionStream("deflate"))).blob();
        const picture = await deflate('{"kind": "fleet", "time_s": 1, "robots": []}');
        socket.onmessage({data: '{"kind": "hello", "fresh_s": 60}'});
        socket.onmessage({data: picture});
        socket.onmessage({data: '{"kind": "reply"}'});
        socket.onmessage({data: '{"kind": "event"}'});
        socket.onclose();
        await over;
        connection.close();
        return kinds; }"""
    )
    assert kinds == ["hello", "fleet", "reply", "event", "closed"]
