# SPDX-License-Identifier: MIT
from segway_ecc.deploy.station.web.access import Role, Sessions, named
from segway_ecc.deploy.station.web.limits import Limits

S = 1_000_000_000
MINUTE = 60 * S


def test_a_session_is_found_by_its_secret_only() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.VIEWER, 0)
    assert sessions.find(secret, 0) is session
    assert (session.who, session.role) == ("ann", Role.VIEWER)
    assert sessions.find("", 0) is None
    assert sessions.find(secret + "x", 0) is None


def test_it_ends_after_half_an_hour_of_silence() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.VIEWER, 0)
    assert sessions.find(secret, 30 * MINUTE) is session
    assert sessions.find(secret, 60 * MINUTE) is session
    assert sessions.find(secret, 90 * MINUTE + 1) is None
    sessions.sweep(90 * MINUTE + 1)
    assert session.is_over
    assert len(sessions) == 0


def test_it_ends_after_twelve_hours_whatever_happens() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.VIEWER, 0)
    session.sockets = 1
    for minute in range(0, 12 * 60, 10):
        sessions.sweep(minute * MINUTE)
    assert sessions.find(secret, 12 * 60 * MINUTE) is session
    assert sessions.find(secret, 12 * 60 * MINUTE + 1) is None


def test_an_open_page_is_not_idle() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.VIEWER, 0)
    session.sockets = 1
    sessions.sweep(29 * MINUTE)
    session.sockets = 0
    assert sessions.find(secret, 50 * MINUTE) is session


def test_logout_ends_session() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.VIEWER, 0)
    sessions.end(session)
    assert session.is_over
    assert sessions.find(secret, 0) is None


def test_no_two_have_the_same_name_at_the_same_time() -> None:
    sessions = Sessions(Limits())
    names = [sessions.begin("ann", Role.OPERATOR, 0)[1].who for _ in range(3)]
    assert names == ["ann", "ann 2", "ann 3"]


def test_returning_operator_regains_name_unless_it_is_in_use() -> None:
    sessions = Sessions(Limits())
    secret, first = sessions.begin("ann", Role.OPERATOR, 0)
    _, second = sessions.begin("bob", Role.OPERATOR, 0)
    second.sockets = 1
    assert sessions.begin("ann", Role.OPERATOR, 11 * S)[1].who == "ann"
    assert first.is_over
    assert sessions.find(secret, 11 * S) is None
    assert sessions.begin("bob", Role.OPERATOR, 11 * S)[1].who == "bob 2"
    assert not second.is_over


def test_sessions_are_bounded_and_those_with_a_browser_stay() -> None:
    sessions = Sessions(Limits())
    secret, session = sessions.begin("ann", Role.OPERATOR, 0)
    session.sockets = 1
    for number in range(1100):
        sessions.begin(f"s{number}", Role.OPERATOR, 0)
    assert len(sessions) == 1000
    assert sessions.find(secret, 0) is session


def test_names_are_fit_to_be_shown() -> None:
    assert named("  Ann   of the\twest \x1b[31m", "x") == "Ann of thewest [31m"
    assert named("\n\x00\u202e", "operator") == "operator"
    assert len(named("x" * 1_000_000, "")) == 40
