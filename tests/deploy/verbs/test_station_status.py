# SPDX-License-Identifier: MIT
"""The robots on one screen; the exit code is by their state."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.station.views import FleetView, RobotView
from segway_ecc.deploy.verbs.station_status import exit_code, screen
from segway_ecc.node.cli.main import main
from tests.ros_domains import next_domain

FAKE = Path(__file__).parents[1] / "station" / "fake_robot.py"
WELL = RobotView(
    robot="/a",
    name="alice",
    is_alive=True,
    age_s=0.04,
    mode="ARMED",
    reason="asked to arm",
    drives="on",
    is_zero=False,
    pitch=0.1,
    linear_velocity=1.0,
    angular_velocity=-0.5,
    supply_v=24.44,
    timing={"rate_hz": "100.0"},
    links={"can": {"state": "active", "sent": "3"}},
    checklist={"rate": "ok", "tilt": "refused: 1.0 rad"},
)
FAULT = RobotView(robot="/f", is_alive=True, mode="FAULT")
LOST = RobotView(robot="/l", is_alive=False, mode="ARMED", age_s=3.0)


def fleet(*robots: RobotView) -> FleetView:
    return FleetView(time_s=1.0, robots=robots)


@pytest.mark.parametrize(
    ("robots", "code"), [((WELL,), 0), ((WELL, FAULT), 10), ((WELL, LOST), 7), ((LOST, FAULT), 10)]
)
def test_the_exit_code(robots: tuple[RobotView, ...], code: int) -> None:
    assert exit_code(fleet(*robots)) == code


def test_fleet_is_settled_once_every_robot_has_sent_all() -> None:
    assert not fleet().is_settled
    assert fleet(WELL, LOST).is_settled
    assert not fleet(WELL, FAULT).is_settled


@pytest.mark.parametrize(
    ("reason", "posture", "way"),
    [("stop was pressed", "FALLEN", "clear_fault, then stand_up"), ("stop was pressed", "", "clear_fault, then arm")],
)
def test_a_stopped_robot_is_shown_with_its_way_back(reason: str, posture: str, way: str) -> None:
    lines = screen(RobotView(robot="/f", mode="FAULT", reason=reason, posture=posture)).splitlines()
    assert [line.partition("way back")[2].strip() for line in lines if "way back" in line] == [way]


def test_a_robot_whose_fault_has_another_cause_is_shown_without_it() -> None:
    assert "way back" not in screen(RobotView(robot="/f", mode="FAULT", reason="tilt", posture="FALLEN"))


def test_the_screen() -> None:
    assert screen(WELL).splitlines() == [
        "/a  alice",
        "  mode            ARMED: asked to arm",
        "  received        0.04 s ago",
        "  tilt            5.73 deg",
        "  velocity        +1.000 m/s  -0.500 rad/s",
        "  set-point       -",
        "  drives          on, commanded",
        "  battery         24.44 V",
        "  link can        state active, sent 3",
        "  timing rate_hz  100.0",
        "  check rate      ok",
        "  check tilt      refused: 1.0 rad",
    ]


def test_a_lost_robot_is_not_shown_as_if_it_lived() -> None:
    assert "3.00 s ago, LOST" in screen(LOST)
    assert "LOST" not in screen(WELL)


def test_no_text_of_the_network_commands_the_terminal() -> None:
    evil = RobotView(robot="/a", name="\x1b[2J", mode="ARMED", reason="a\nb\x07", timing={"\x1b]0;x": "\x9b1m"})
    shown = screen(evil)
    assert not set(shown) & {"\x1b", "\x07", "\x9b"}
    assert "ARMED: a?b?" in shown


@pytest.mark.parametrize("wait", ["0", "-1", "3601"])
def test_a_wait_that_is_none(wait: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["station", "status", "--wait", wait]) == 2
    assert "--wait must be more than 0 s" in capsys.readouterr().err


@pytest.fixture
def robots(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., None]]:
    """Starts robots that are not there, in a ROS domain of the test's own; changes one of them."""
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    with contextlib.ExitStack() as stack:

        def start(*namespaces: str, **values: str) -> None:
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, str(FAKE), *namespaces],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    text=True,
                    env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
                )
            )
            stack.callback(process.kill)
            assert process.stdin is not None
            process.stdin.write(json.dumps({"robot": namespaces[0], "set": values}) + "\n")
            process.stdin.flush()

        yield start


@pytest.mark.ros
def test_every_robot_on_the_network_is_listed(robots: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    robots("/a", "/b")
    assert main(["station", "status", "--json", "--wait", "30"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [(robot["robot"], robot["mode"], robot["is_alive"]) for robot in shown["robots"]] == [
        ("/a", "DISARMED", True),
        ("/b", "DISARMED", True),
    ]
    assert shown["robots"][0]["timing"]["rate_hz"] == "100.0012"


@pytest.mark.ros
def test_a_fault_is_in_the_exit_code(robots: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    robots("/a", mode="FAULT", reason="tilt")
    assert main(["station", "status", "--wait", "30"]) == 10
    assert "FAULT, BALANCING: tilt" in capsys.readouterr().out


@pytest.mark.ros
@pytest.mark.usefixtures("robots")
def test_no_robot_found_is_reported_with_what_to_start(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["station", "status", "--wait", "0.5"]) == 6
    out, err = capsys.readouterr()
    assert not out
    assert "no robot was found within 0.5 s" in err
    assert "segway-ecc run ROBOT" in err
