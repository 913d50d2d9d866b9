# SPDX-License-Identifier: MIT
"""What cycles carry, in words."""

import json

import pytest

from segway_ecc.deploy.station.playback import log_events
from segway_ecc.deploy.station.playback.log_events import EventCollector
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.recording.cdr import diagnostic_array


@pytest.mark.parametrize(
    ("piece", "kind", "text", "level"),
    [
        (["fault", "left: overcurrent"], "fault", "left: overcurrent", "error"),
        (["event", "can: lost"], "link", "can: lost", "warning"),
        (["warning", "payload 0.5 kg"], "warning", "payload 0.5 kg", "warning"),
        (["warning", ""], "warning", "nothing differs from the design any more", "warning"),
        (["requests", "clear_fault"], "request", "clear fault was requested", "info"),
        (["written", ["MaxSpeed", 0.5, "", False]], "parameter", "MaxSpeed = 0.5", "info"),
        (["written", ["Gain", 9, "too large", False]], "parameter", "Gain = 9 was refused: too large", "warning"),
        (["values", [0, 1.0]], "request", "stand = 1.0", "info"),
        (["values", [7, 1.0]], "request", "value 7 = 1.0", "info"),
        (["introductions", "workshop"], "station", "station workshop watches over the robot", "info"),
        (["trajectories", [1]], "trajectory", "a trajectory was received", "info"),
        (["answer", "arm", ["not still"]], "request", "arming was refused: not still", "error"),
        (["answer", "send", ["no cable"]], "link", "the link was lost: no cable", "error"),
    ],
)
def test_each_kind_of_text_is_an_event(piece: list[object], kind: str, text: str, level: str) -> None:
    events = EventCollector(["stand"])
    events.on_text(1.5, 300, json.dumps(piece))
    (event,) = events.events
    assert (event.time_s, event.cycle, event.kind, event.text, event.level) == (1.5, 300, kind, text, level)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "[1]",
        '["setpoints",[[0.1,0.2],5]]',
        '["answer","obstacles",["a"]]',
        '["stations",["a",1]]',
        "[" * 5000,
    ],
)
def test_what_is_no_event_or_comes_all_the_time_is_left_out(text: str) -> None:
    events = EventCollector()
    events.on_text(0.0, 0, text)
    assert events.events == []


def test_fault_that_lasts_is_one_event_and_one_that_comes_back_another() -> None:
    events = EventCollector()
    for cycle in (10, 11, 12, 20, 21):
        events.on_text(0.005 * cycle, cycle, '["fault","left: overcurrent"]')
    assert [event.cycle for event in events.events] == [10, 20]


def test_value_that_is_set_again_is_no_event() -> None:
    events = EventCollector(["stand"])
    for cycle, value in ((1, 1.0), (9, 1.0), (20, 0.0), (30, 1.0)):
        events.on_text(0.0, cycle, json.dumps(["values", [0, value]]))
    assert [event.text for event in events.events] == ["stand = 1.0", "stand = 0.0", "stand = 1.0"]


def test_more_events_than_are_kept_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_events, "MOST_EVENTS", 3)
    events = EventCollector()
    for cycle in range(0, 10, 2):
        events.on_text(0.0, cycle, '["event","link"]')
    events.on_mode(1.0, 200, "FAULT", 5)
    events.on_diagnostics(diagnostic_array(6, "", [DiagnosticStatus(Level.OK, "a: mode", "", {"mode": "FAULT"})]))
    assert (len(events.events), events.left_off) == (3, 3)


def test_reason_comes_from_the_diagnostics_that_follow_and_name_the_same_mode() -> None:
    def diagnostics(stamp_ns: int, mode: str, reason: str) -> bytes:
        values = {"mode": mode, "reason": reason}
        others = DiagnosticStatus(Level.OK, "a: timing", "fine", {"mode": mode})
        return diagnostic_array(stamp_ns, "", [others, DiagnosticStatus(Level.OK, "a: mode", "", values)])

    events = EventCollector()
    events.on_mode(1.0, 200, "ARMED", 5000)
    events.on_diagnostics(diagnostics(4000, "DISARMED", "just started"))
    events.on_diagnostics(b"damaged")
    assert events.events[0].text == ""
    events.on_diagnostics(diagnostics(6000, "ARMED", "asked to arm"))
    events.on_mode(2.0, 400, "HOLD", 7000)
    events.on_diagnostics(diagnostics(8000, "FAULT", "stop was pressed"))
    assert [event.text for event in events.events] == ["asked to arm", ""]
