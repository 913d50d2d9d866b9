# SPDX-License-Identifier: MIT
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.deploy.station.robot_messages import ModeReport, decode_health, decode_mode, finite
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

TOLD = {
    "mode": "HOLD",
    "reason": "no set-point arrives any more",
    "cycle": "12",
    "drives": "on",
    "zero": "false",
    "heartbeat": "base station 1 123456789",
    "heartbeat_age_ms": "12.5",
    "stand": "0.0",
    "posture": "SITTING DOWN",
}


def test_a_whole_message() -> None:
    expected = ModeReport(
        name="alice",
        mode=Mode.HOLD,
        reason="no set-point arrives any more",
        drives="on",
        is_zero=False,
        station="base station 1",
        beat_ns=123_456_789,
        beat_age_ns=12_500_000,
        posture=Posture.SITTING_DOWN,
    )
    assert decode_mode("alice: mode", TOLD) == expected


def test_unreported_values_are_none() -> None:
    reported = decode_mode("alice: mode", {"mode": "ARMED"})
    assert reported == ModeReport("alice", Mode.ARMED, "")
    assert reported.is_zero is None


@pytest.mark.parametrize(
    ("name", "mode"), [("alice: timing", "ARMED"), ("alice: mode", "DANCING"), ("alice: mode", "")]
)
def test_a_status_that_is_no_mode_is_refused(name: str, mode: str) -> None:
    assert decode_mode(name, {"mode": mode}) is None


@pytest.mark.parametrize(
    "beat", ["", "base", "base x", "base -1", " 5", "base " + "9" * 21, "base \N{SUPERSCRIPT TWO}"]
)
def test_an_echo_that_is_none(beat: str) -> None:
    reported = decode_mode("a: mode", {**TOLD, "heartbeat": beat})
    assert reported is not None
    assert (reported.station, reported.beat_ns) == ("", 0)


@pytest.mark.parametrize("age", ["nan", "inf", "-1", "soon", ""])
def test_an_age_that_is_none(age: str) -> None:
    reported = decode_mode("a: mode", {**TOLD, "heartbeat_age_ms": age})
    assert reported is not None
    assert reported.beat_age_ns == 0


@pytest.mark.parametrize(
    ("mode", "drives", "zero", "stopped"),
    [
        ("FAULT", "off", "false", True),
        ("FAULT", "on", "true", False),
        ("FAULT", "unconfirmed", "true", False),
        ("FAULT", "offline", "true", False),
        ("FAULT", "none", "true", True),
        ("FAULT", "on", "false", False),
        ("FAULT", "none", "false", False),
        ("FAULT", "", "true", False),
        ("FAULT", "none", "", False),
        ("DISARMED", "off", "true", False),
        ("ARMED", "off", "true", False),
    ],
)
def test_stopped_is_what_the_drive_does_and_not_the_mode_alone(
    mode: str, drives: str, zero: str, *, stopped: bool
) -> None:
    reported = decode_mode("a: mode", {"mode": mode, "drives": drives, "zero": zero})
    assert reported is not None
    assert reported.is_stopped is stopped


@pytest.mark.parametrize("drives", ["on", "off", "none", "unconfirmed"])
def test_what_the_drives_do_is_kept_whole(drives: str) -> None:
    reported = decode_mode("a: mode", {**TOLD, "drives": drives})
    assert reported is not None
    assert reported.drives == drives


def test_unknown_drives_state_is_discarded() -> None:
    reported = decode_mode("a: mode", {**TOLD, "drives": "of course"})
    assert reported is not None
    assert reported.drives == ""


@given(st.text(), st.dictionaries(st.sampled_from(sorted(TOLD)), st.text() | st.sampled_from(list(TOLD.values()))))
def test_no_message_of_the_network_raises(name: str, values: dict[str, str]) -> None:
    for who in (name, f"{name}: mode"):
        reported = decode_mode(who, values)
        assert reported is None or len(reported.reason) <= 500
    decode_health([(f"x: {part}", values) for part in ("mode", "timing", "hardware")])


def test_diagnostics_of_a_robot_with_two_lines() -> None:
    health = decode_health(
        [
            ("a: mode", {"mode": "ARMED", "check.rate": "ok: 100 Hz", "check.tilt": "refused: 1.0 rad"}),
            ("a: timing", {"rate_hz": "100.0"}),
            ("a: set-points", {"applied": "3"}),
            (
                "a: hardware",
                {
                    "link": "can can0, serial ttyS0",
                    "link.owner": "can",
                    "link.can.state": "active",
                    "link.serial.refused.crc": "3",
                    "link.refused.crc": "4",
                    "board.state": "ENABLED",
                },
            ),
        ]
    )
    assert health.checklist == {"rate": "ok", "tilt": "refused: 1.0 rad"}
    assert health.timing == {"rate_hz": "100.0"}
    assert health.links == {
        "link": {"description": "can can0, serial ttyS0", "owner": "can", "refused.crc": "4"},
        "can": {"state": "active"},
        "serial": {"refused.crc": "3"},
    }


def test_no_more_is_kept_of_diagnostics_than_fits() -> None:
    health = decode_health([("a: timing", {f"{index}" + "k" * 900: "v" * 900 for index in range(999)})])
    assert len(health.timing) == 200
    assert all(len(key) == len(value) == 500 for key, value in health.timing.items())


def test_a_number_that_is_none_is_not_known() -> None:
    assert finite(1.5) == 1.5
    assert finite(math.nan) is None
    assert finite(-math.inf) is None


@pytest.mark.parametrize(
    ("values", "limits"),
    [
        ({"tilt_limit_rad": "0.8", "down_rad": "0.4"}, (0.8, 0.4)),
        ({"tilt_limit_rad": "0.6"}, (0.6, None)),
        ({}, (None, None)),
        ({"tilt_limit_rad": "nan", "down_rad": "-1"}, (None, None)),
        ({"tilt_limit_rad": "wide", "down_rad": "0"}, (None, None)),
    ],
)
def test_tilt_limits_are_positive_numbers_or_none(
    values: dict[str, str], limits: tuple[float | None, float | None]
) -> None:
    health = decode_health([("alice: mode", {"mode": "ARMED", **values})])
    assert (health.tilt_limit_rad, health.down_rad) == limits
