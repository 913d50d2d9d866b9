# SPDX-License-Identifier: MIT
"""Who is at the page: the form where the station wants one."""

from typing import TYPE_CHECKING

import pytest

from segway_ecc.deploy.station.views import Act
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, press, shows
from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser


def _new_page(browser: "Browser") -> "Page":
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_S * 1e3)
    return page


def _sign_in(page: "Page", name: str, token: str) -> None:
    page.fill("#login-name", name)
    page.fill("#login-token", token)
    page.keyboard.press("Enter")


def test_a_token_lets_in(browser: "Browser", station: FakeStation) -> None:
    station.script.token = "secret"  # noqa: S105 - of the fake station
    page = _new_page(browser)
    page.goto(station.url)
    page.locator("#login-form").wait_for()
    gone(page, "#station")
    gone(page, "#bar")
    assert page.evaluate("() => document.activeElement.id") == "login-name"
    _sign_in(page, "zoe", "wrong")
    shows(page, "#login-error", "the token is wrong")
    assert station.sockets == 0
    _sign_in(page, "zoe", "secret")
    shows(page, "#who", "zoe, operator")
    shows(page, "#mode", "ARMED")
    gone(page, "#login")
    assert station.logins[-1] == {"name": "zoe", "token": "secret"}
    assert page.input_value("#login-token") == "", "it is not kept in the page"
    page.close()


def test_a_session_that_has_ended_asks_again(browser: "Browser", station: FakeStation) -> None:
    page = _new_page(browser)
    page.goto(station.url)
    shows(page, "#mode", "ARMED")
    station.script.token = "secret"  # noqa: S105 - of the fake station
    station.cut()
    page.locator("#login-form").wait_for()
    gone(page, "#station")
    page.close()


def test_another_may_sign_in(page: "Page", station: FakeStation) -> None:
    page.click("#change-user")
    page.locator("#login-form").wait_for()
    _sign_in(page, "bert", "")
    shows(page, "#who", "bert, operator")
    assert station.logins == [{"name": "bert", "token": ""}]


def test_who_comes_next_waits_for_nothing_that_another_asked_for(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.DISARM] = None
    press(page, "disarm")
    station.wait(lambda: station.commands)
    page.click("#change-user")
    page.locator("#login-form").wait_for()
    _sign_in(page, "ann", "")
    shows(page, "#command-failure", "the connection broke before an answer came")


def test_no_stop_is_promised_where_there_is_none(page: "Page", station: FakeStation) -> None:
    page.click("#change-user")
    page.locator("#login-form").wait_for()
    gone(page, "#bar")
    page.fill("#login-name", "a b")
    assert page.input_value("#login-name") == "a b"
    page.keyboard.press("Escape")
    station.wait_frames(2)
    assert station.commands == []
