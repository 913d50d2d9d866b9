# SPDX-License-Identifier: MIT
"""Whether a node is healthy, from what systemd shows of it."""

import dataclasses
from typing import Any

import pytest

from segway_ecc.deploy.release.agent.services import Service, Trial

GOOD = {"mode": "DISARMED", "reason": "started", "rate_hz": 200.0, "late": 0, "blocked_by": ["tilt: it lies"]}
STOPPED = Service(load="loaded")


def node(*, active: str = "active", pid: int = 5, restarts: int = 0, **status: Any) -> Service:
    return Service("loaded", active, "running", restarts, pid, {**GOOD, **status})


def trial(before: Service = STOPPED) -> Trial:
    return Trial(for_s=10.0, start_s=30.0, rate_hz=200.0, before=before)


def test_healthy_is_who_was_so_for_long_enough_on_end() -> None:
    watch = trial()
    assert watch.watch(node(active="activating"), 0.0) is None
    assert watch.watch(node(), 5.0) is None
    assert watch.watch(node(rate_hz=190.0), 12.0) is None, "it begins again"
    assert watch.watch(node(), 13.0) is None
    assert watch.watch(node(), 22.9) is None
    assert watch.watch(node(), 23.0) is True


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        (node(active="activating"), "is still activating"),
        (dataclasses.replace(node(), status=None), "reports no status"),
        (node(rate_hz=197.9), "its loop runs at 197.9 Hz instead of 200 Hz"),
        (node(rate_hz=202.1), "its loop runs at 202.1 Hz"),
        (node(rate_hz=float("nan")), "its loop runs at nan Hz"),
        (node(rate_hz=None), "does not report its rate"),
        (node(blocked_by=["tilt: it lies", "sensors: too old: left.angle"]), "cannot be armed: sensors: too old"),
        (node(blocked_by=["drives: overheated"]), "cannot be armed: drives: overheated"),
    ],
)
def test_who_does_not_become_healthy_in_time_is_not(seen: Service, reason: str) -> None:
    watch = trial()
    assert watch.watch(seen, 40.0) is None
    assert watch.watch(seen, 40.1) is False
    assert reason in watch.reason


@pytest.mark.parametrize("rate_hz", [198.0, 202.0])
def test_one_percent_is_allowed(rate_hz: float) -> None:
    watch = trial()
    watch.watch(node(rate_hz=rate_hz), 0.0)
    assert watch.watch(node(rate_hz=rate_hz), 10.0) is True


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        (node(active="failed", pid=0), "is failed"),
        (node(active="inactive", pid=0), "is inactive"),
        (node(restarts=1), "had to be restarted 1 times"),
        (node(pid=6), "ended and was started again"),
        (node(mode="FAULT", reason="tilt"), "the robot is in FAULT: tilt"),
        (Service(), "is not installed (not-found)"),
    ],
)
def test_some_things_are_not_waited_for(seen: Service, reason: str) -> None:
    watch = trial()
    watch.watch(node(), 0.0)
    assert watch.watch(seen, 0.1) is False
    assert reason in watch.reason


def test_what_kept_the_robot_from_arming_before_is_not_held_against_a_version() -> None:
    watch = trial(before=node(blocked_by=["sensors: too old: left.angle"]))
    watch.watch(node(blocked_by=["sensors: too old: right.angle"]), 0.0)
    assert watch.watch(node(blocked_by=["sensors: too old: right.angle"]), 10.0) is True


def test_restarts_before_the_update_are_not_held_against_a_version() -> None:
    watch = trial(before=node(restarts=3))
    assert watch.watch(node(restarts=3), 0.0) is None
    assert watch.watch(node(restarts=4), 0.1) is False


@pytest.mark.parametrize(
    ("seen", "is_safe"),
    [
        (node(mode="DISARMED"), True),
        (node(mode="FAULT"), True),
        (node(mode="ARMED"), False),
        (node(mode="HOLD"), False),
        (node(mode="ARMED", pid=0), True),
        (Service("loaded", "active", "running", 0, 5, None), False),
        (Service("loaded", "activating", "start", 0, 5, None), True),
        (STOPPED, True),
        (Service(), True),
    ],
)
def test_a_node_that_may_be_restarted(*, seen: Service, is_safe: bool) -> None:
    assert (seen.why_not_safe() is None) is is_safe
