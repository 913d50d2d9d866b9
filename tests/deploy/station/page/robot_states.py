# SPDX-License-Identifier: MIT
"""What a station tells of a robot, in the forms that the robot's diagnostics have."""

from collections.abc import Mapping
from typing import Final

CHECKS: Final[Mapping[str, str]] = {
    "rate": "ok: 200.01 Hz of 200 Hz over the last second",
    "telemetry": "ok: the newest value is 2.1 ms old",
    "imu_still": "refused: still for 0.40 s of 1 s; hold the robot still, or see how the IMU is mounted",
    "tilt": "refused: 0.31 rad from upright, allowed is 0.1 rad; hold the robot upright",
    "supply": "ok: 24.9 V, allowed is 20 to 29.4 V",
    "real_time": "warning: not granted; run as root, or raise the limit: ulimit -r",
}
GOOD_CHECKS: Final = dict.fromkeys(CHECKS, "ok: as it should be")
LINKS: Final = {
    "link": {"owner": "can", "description": "can: local robot, serial: the line to fall back on"},
    "can": {
        "state": "active",
        "sent_per_s": "400.0",
        "received_per_s": "800.2",
        "errors_per_s": "0.0",
        "load_percent": "18.4",
        "sent": "120031",
    },
    "serial": {
        "state": "gone",
        "lost": "the port is gone",
        "sent_per_s": "0.0",
        "received_per_s": "0.0",
        "errors_per_s": "0.0",
        "load_percent": "0.0",
    },
}
TIMING: Final = {
    "rate_hz": "200.0012",
    "wanted_rate_hz": "200",
    "cycles": "36120",
    "late": "2",
    "overrun": "0",
    "skipped": "1",
    "lateness": "p50 8.2 us, p99 31.0 us, p99.9 58.5 us, max 402.1 us",
    "exchange": "p50 61.3 us, p99 92.0 us, p99.9 140.5 us, max 311.7 us",
    "equations": "p50 44.0 us, p99 61.0 us, p99.9 83.0 us, max 190.4 us",
}


def armed(**fields: object) -> dict[str, object]:
    """What is reported of a robot that is armed and in ann's control."""
    reported: dict[str, object] = {
        "name": "Alice",
        "is_alive": True,
        "age_s": 0.02,
        "round_trip_s": 0.0042,
        "mode": "ARMED",
        "reason": "armed by ann",
        "drives": "on",
        "is_zero": False,
        "pitch": 0.0524,
        "linear_velocity": 0.412,
        "angular_velocity": -0.2,
        "linear_setpoint": 0.4,
        "angular_setpoint": -0.25,
        "x": 1.25,
        "y": -0.5,
        "heading": 0.7854,
        "supply_v": 24.86,
        "checklist": dict(GOOD_CHECKS),
        "links": LINKS,
        "timing": TIMING,
        "controller": "ann",
        "can_stand": True,
        "posture": "BALANCING",
        "tilt_limit_rad": 0.8,
        "down_rad": 0.4,
        "stop": "",
        "stop_after_s": None,
        "sequence": None,
    }
    return {**reported, **fields}


def lost(**fields: object) -> dict[str, object]:
    """What is reported of a robot that fell silent: what it last was, and no number."""
    unknown = ("round_trip_s", "is_zero", "pitch", "linear_velocity", "angular_velocity", "linear_setpoint")
    more = ("angular_setpoint", "x", "y", "heading", "supply_v")
    reported = {"is_alive": False, "age_s": 3.4, **dict.fromkeys((*unknown, *more))}
    return armed(**reported, links={}, timing={}, checklist={}, **fields)
