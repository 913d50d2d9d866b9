# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.station.web.site_address import SiteAddress

LOOPBACK = SiteAddress("http", 8700)
LAN = SiteAddress("https", 8700, frozenset({"base", "base.local"}), is_loopback=False)


@pytest.mark.parametrize("host", ["127.0.0.1:8700", "localhost:8700", "LOCALHOST:8700", "[::1]:8700", "127.0.0.9:8700"])
def test_loopback_is_known_by_its_names(host: str) -> None:
    assert LOOPBACK.is_ours(host)


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "127.0.0.1",
        "127.0.0.1:8701",
        "evil.example:8700",
        "localhost.evil.example:8700",
        "127.0.0.1.evil.example:8700",
        "192.0.2.1:8700",
        "127.0.0.1:8700:8700",
        "127.0.0.1:8700/",
        "user@127.0.0.1:8700",
        "127.0.0.1 :8700",
        "127.0.0.1:\u0668700",
        "base:8700",
        "2130706433:8700",
        "[::1",
        "127.0.0.1:8700\n",
    ],
)
def test_loopback_is_known_by_nothing_else(host: str | None) -> None:
    assert not LOOPBACK.is_ours(host)


def test_elsewhere_it_is_known_by_any_address_and_by_its_names() -> None:
    assert all(LAN.is_ours(f"{name}:8700") for name in ("192.0.2.1", "[2001:db8::1]", "base", "BASE.local", "base."))
    assert not LAN.is_ours("evil.example:8700")


def test_missing_port_defaults_to_scheme() -> None:
    assert SiteAddress("https", 443, frozenset({"base"}), is_loopback=False).is_ours("base")
    assert not LAN.is_ours("base")


HOST = {"Host": "127.0.0.1:8700"}
OURS = {**HOST, "Origin": "http://127.0.0.1:8700"}


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_own_page_passes(method: str) -> None:
    assert LOOPBACK.may_request(method, OURS | {"Cookie": "a=b", "Sec-Fetch-Site": "same-origin"})
    assert LOOPBACK.may_request(method, OURS, opens_socket=True)


@pytest.mark.parametrize(
    "origin",
    [
        "null",
        "",
        "http://evil.example",
        "https://127.0.0.1:8700",
        "http://127.0.0.1",
        "http://127.0.0.1:8701",
        "http://localhost:8700",
        "http://127.0.0.1:8700/",
        "http://127.0.0.1:8700.evil.example",
    ],
)
def test_foreign_origin_is_refused(origin: str) -> None:
    for method in ("GET", "POST"):
        for opens_socket in (False, True):
            assert not LOOPBACK.may_request(method, HOST | {"Origin": origin}, opens_socket=opens_socket)


def test_what_changes_something_names_its_origin_unless_no_browser_sent_it() -> None:
    for method, opens_socket in (("POST", False), ("GET", True)):
        assert LOOPBACK.may_request(method, HOST, opens_socket=opens_socket)
        for sign in ({"Cookie": "a=b"}, {"Sec-Fetch-Site": "same-origin"}, {"Sec-Fetch-Site": "none"}):
            assert not LOOPBACK.may_request(method, HOST | sign, opens_socket=opens_socket)


def test_looking_is_for_our_page_and_for_who_follows_a_link() -> None:
    visit = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert LOOPBACK.may_request("GET", HOST | visit)
    assert LOOPBACK.may_request("GET", HOST | {"Sec-Fetch-Site": "same-origin", "Cookie": "a=b"})
    assert LOOPBACK.may_request("GET", HOST | {"Sec-Fetch-Site": "none"})
    assert not LOOPBACK.may_request("GET", HOST | visit | {"Sec-Fetch-Dest": "iframe"})
    assert not LOOPBACK.may_request("GET", HOST | {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"})
    assert not LOOPBACK.may_request("GET", HOST | {"Sec-Fetch-Site": "same-site"})
