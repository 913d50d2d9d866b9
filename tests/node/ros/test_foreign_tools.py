# SPDX-License-Identifier: MIT
"""The model node as other people's ROS tools see it: a process with none of our code looks, drives and asks."""

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ros_processes import Ask, Start, receive_until

pytestmark = pytest.mark.ros

PERIOD_NS = 10_000_000
NS_PER_S = 1_000_000_000
TRIES = 2000
RELIABLE = ["RELIABLE", "VOLATILE"]
IN = {
    "cmd_vel": ["geometry_msgs/msg/Twist", *RELIABLE],
    "cmd_vel_stamped": ["geometry_msgs/msg/TwistStamped", *RELIABLE],
    "cmd_trajectory": ["trajectory_msgs/msg/MultiDOFJointTrajectory", *RELIABLE],
    "station": ["std_msgs/msg/Header", "BEST_EFFORT", "VOLATILE"],
    "watch": ["std_msgs/msg/String", *RELIABLE],
}
OUT = {
    "position": ["geometry_msgs/msg/Point", *RELIABLE],
    "linear_velocity": ["std_msgs/msg/Float64", *RELIABLE],
    "angular_velocity": ["std_msgs/msg/Float64", *RELIABLE],
    "odom": ["nav_msgs/msg/Odometry", *RELIABLE],
    "joint_states": ["sensor_msgs/msg/JointState", *RELIABLE],
    "robot_description": ["std_msgs/msg/String", "RELIABLE", "TRANSIENT_LOCAL"],
    "diagnostics": ["diagnostic_msgs/msg/DiagnosticArray", *RELIABLE],
    "setpoint": ["geometry_msgs/msg/TwistStamped", *RELIABLE],
    "mode": ["diagnostic_msgs/msg/DiagnosticStatus", *RELIABLE],
    "trajectory_status": ["diagnostic_msgs/msg/DiagnosticStatus", *RELIABLE],
}
SERVICES = {f"model/{name}": ["std_srvs/srv/Trigger"] for name in ("arm", "disarm", "stop", "clear_fault")}


@pytest.fixture(scope="module", autouse=True)
def robots(start_for_all: Start, foreign: Ask) -> None:
    """One robot without a namespace and one in /robot1, for the whole module."""
    start_for_all("robot", "run", "cart", "--ros", "--no-log")
    start_for_all("robot1", "run", "cart", "--ros", "--no-log", "--namespace", "/robot1")
    assert foreign("wait_for", node="model", namespace="/")
    assert foreign("wait_for", node="model", namespace="/robot1")


@pytest.fixture
def armed(foreign: Ask) -> Iterator[None]:
    """The robot at rest and armed, whatever the test before left."""
    foreign("call", service="/model/disarm")
    foreign("call", service="/model/clear_fault")
    assert foreign("call", service="/model/arm")[0] is True
    receive_until(foreign, "/odom", lambda odom: abs(odom["linear"]) < 0.01 and abs(odom["angular"]) < 0.01)
    yield
    foreign("call", service="/model/disarm")


def diagnostics(foreign: Ask, wanted: Callable[[Any], bool]) -> Any:
    """The first diagnostics of the robot without a namespace that are as wanted: the other's are on the topic too."""
    return receive_until(foreign, "/diagnostics", lambda all_: "cart: mode" in all_ and wanted(all_))


def mode(foreign: Ask, wanted: str) -> dict[str, Any]:
    found: dict[str, Any] = diagnostics(foreign, lambda all_: all_["cart: mode"]["mode"] == wanted)
    return found["cart: mode"]  # type: ignore[no-any-return]  # JSON


def newest(foreign: Ask, topic: str) -> Any:
    """A message that comes after this call."""
    foreign("receive", topic=topic)
    return foreign("receive", topic=topic)[-1]


def setpoints_told(foreign: Ask) -> dict[str, Any]:
    """The set-point counts of a report that was made after this call."""
    foreign("receive", topic="/diagnostics")
    return diagnostics(foreign, lambda _: True)["cart: set-points"]  # type: ignore[no-any-return]  # JSON


def drive_until(foreign: Ask, linear: float, angular: float, wanted: Callable[[Any], bool], prefix: str = "") -> Any:
    """Command a robot with each odometry received, until the odometry is as wanted."""
    for _ in range(TRIES):
        assert foreign("publish", topic=f"{prefix}/cmd_vel", kind="Twist", linear=linear, angular=angular)
        odom = foreign("receive", topic=f"{prefix}/odom")[-1]
        if wanted(odom):
            return odom
    pytest.fail(f"the robot does not follow; its odometry is {odom}")


@pytest.mark.parametrize("prefix", ["", "/robot1"], ids=["no namespace", "/robot1"])
def test_topics_and_services_are_those_of_the_table(foreign: Ask, prefix: str) -> None:
    table = {"in": IN, "out": OUT, "services": SERVICES}
    expected = {part: {f"{prefix}/{name}": kind for name, kind in rows.items()} for part, rows in table.items()}
    expected["out"]["/diagnostics"] = OUT["diagnostics"]

    assert foreign("look", namespace=prefix or "/", expected=expected) == expected


@pytest.mark.usefixtures("armed")
def test_cmd_vel_drives_the_cart_and_every_topic_agrees(foreign: Ask) -> None:
    before = newest(foreign, "/odom")
    foreign("receive", topic="/joint_states")
    odom = drive_until(foreign, 0.5, 1.0, lambda odom: odom["linear"] > 0.49 and odom["angular"] > 0.98)

    assert odom["frames"] == ["odom", "base_link"]
    assert (odom["x"], odom["y"]) != (before["x"], before["y"])
    assert odom["z"] ** 2 + odom["w"] ** 2 == pytest.approx(1.0)
    # Wheels of 0.05 m on a track of 0.3 m; the cart turns 1.00174 times as fast as commanded.
    assert odom["linear"] == pytest.approx(0.5, abs=0.011)
    joints = receive_until(foreign, "/joint_states", lambda j: j["stamp_ns"] == odom["stamp_ns"])
    assert joints["name"] == ["left_wheel_joint", "right_wheel_joint"]
    left, right = joints["velocity"]
    assert 0.05 * (left + right) / 2 == pytest.approx(odom["linear"])
    assert 0.05 * (right - left) / 0.3 == pytest.approx(odom["angular"])
    assert len(joints["position"]) == 2


@pytest.mark.usefixtures("armed")
def test_single_value_topics_repeat_the_odometry_bit_for_bit(foreign: Ask) -> None:
    topics = ("/position", "/linear_velocity", "/angular_velocity")
    for topic in (*topics, "/odom"):
        foreign("receive", topic=topic)
    drive_until(foreign, 0.5, 1.0, lambda odom: odom["linear"] > 0.4)
    odom = drive_until(foreign, 0.5, 1.0, lambda odom: odom["linear"] > 0.45)

    receive_until(foreign, "/position", lambda point: point == [odom["x"], odom["y"], 0.0])
    receive_until(foreign, "/linear_velocity", lambda value: value == odom["linear"])
    receive_until(foreign, "/angular_velocity", lambda value: value == odom["angular"])


@pytest.mark.usefixtures("armed")
def test_stamps_are_one_period_apart(foreign: Ask) -> None:
    # While set-points wait for their time the time base stands still, so no stamp may be moved.
    start_ns = newest(foreign, "/odom")["stamp_ns"]
    assert foreign(
        "publish", topic="/cmd_vel_stamped", kind="TwistStamped", linear=0.0, angular=0.0, stamp_ns=start_ns + NS_PER_S
    )
    receive_until(foreign, "/odom", lambda odom: odom["stamp_ns"] > start_ns + NS_PER_S // 2)
    stamps = [odom["stamp_ns"] for odom in (*foreign("receive", topic="/odom"), *foreign("receive", topic="/odom"))]

    assert {later - earlier for earlier, later in itertools.pairwise(stamps)} == {PERIOD_NS}


@pytest.mark.usefixtures("armed")
def test_silence_leads_to_hold_at_rest_and_a_new_setpoint_out_of_it(foreign: Ask) -> None:
    drive_until(foreign, 0.5, 0.0, lambda odom: odom["linear"] > 0.45)
    held = mode(foreign, "HOLD")

    assert held["level"] == 1
    assert held["reason"] == "no set-point arrives any more"
    receive_until(foreign, "/odom", lambda odom: abs(odom["linear"]) < 0.005)
    drive_until(foreign, 0.5, 0.0, lambda odom: odom["linear"] > 0.45)


@pytest.mark.usefixtures("armed")
def test_nan_is_refused_and_counted_and_the_last_good_setpoint_stays(foreign: Ask) -> None:
    refused = int(setpoints_told(foreign).get("refused.not_finite", 0))
    # Set-points that are stamped ahead, from four seconds on, keep the robot going meanwhile.
    now_ns = newest(foreign, "/odom")["stamp_ns"] + 4 * NS_PER_S
    for tenth in range(81):
        stamp = now_ns + tenth * NS_PER_S // 10
        assert foreign(
            "publish", topic="/cmd_vel_stamped", kind="TwistStamped", linear=0.5, angular=0.0, stamp_ns=stamp
        )
    fast = receive_until(foreign, "/odom", lambda odom: odom["stamp_ns"] > now_ns and odom["linear"] > 0.49)
    for bad in ((math.nan, 0.0), (0.5, math.nan), (math.inf, 0.0)):
        assert foreign("publish", topic="/cmd_vel", kind="Twist", linear=bad[0], angular=bad[1])
    diagnostics(foreign, lambda all_: int(all_["cart: set-points"].get("refused.not_finite", 0)) == refused + 3)
    stamps = range(fast["stamp_ns"], now_ns + 8 * NS_PER_S)
    driven = [odom["linear"] for odom in foreign("receive", topic="/odom") if odom["stamp_ns"] in stamps]

    assert min(driven) > 0.49


@pytest.mark.usefixtures("armed")
@pytest.mark.parametrize(
    ("ahead_ns", "cause"), [(-NS_PER_S, "stale"), (60 * NS_PER_S, "too_far_ahead")], ids=["stale", "too far ahead"]
)
def test_a_stamp_out_of_bounds_is_refused_and_counted(foreign: Ask, ahead_ns: int, cause: str) -> None:
    before = setpoints_told(foreign)
    stamp = newest(foreign, "/odom")["stamp_ns"] + ahead_ns
    assert foreign("publish", topic="/cmd_vel_stamped", kind="TwistStamped", linear=0.5, angular=0.0, stamp_ns=stamp)
    expected = str(int(before.get(f"refused.{cause}", 0)) + 1)
    after = diagnostics(foreign, lambda a: a["cart: set-points"].get(f"refused.{cause}") == expected)

    assert after["cart: set-points"]["applied"] == before["applied"]
    assert after["cart: set-points"]["level"] == 1


@pytest.mark.usefixtures("armed")
def test_a_stamp_ahead_comes_into_force_at_its_stamp(foreign: Ask) -> None:
    now_ns = newest(foreign, "/odom")["stamp_ns"]
    # A first one far ahead holds the time base, so that the stamps of the others stay on the robot's grid.
    for ahead, linear in ((900, 0.0), (500, 0.25), (510, -0.25)):
        assert foreign(
            "publish",
            topic="/cmd_vel_stamped",
            kind="TwistStamped",
            linear=linear,
            angular=1.5,
            stamp_ns=now_ns + ahead * PERIOD_NS,
        )
    seen: list[Any] = []  # both may be received at once

    def is_second(message: Any) -> bool:
        seen.append(message)
        return bool(message["linear"] == -0.25)

    second = receive_until(foreign, "/setpoint", is_second)
    first = next(message for message in seen if message["linear"] == 0.25)

    assert first == {"stamp_ns": now_ns + 500 * PERIOD_NS, "linear": 0.25, "angular": 1.5}
    assert second == {"stamp_ns": now_ns + 510 * PERIOD_NS, "linear": -0.25, "angular": 1.5}


@pytest.mark.usefixtures("armed")
def test_services_answer_with_reasons_and_change_the_mode(foreign: Ask) -> None:
    assert foreign("call", service="/model/arm") == [True, "armed already"]
    assert foreign("call", service="/model/clear_fault") == [
        False,
        "there is no fault to clear: the robot is ARMED",
    ]
    assert foreign("call", service="/model/stop") == [True, "FAULT: stop was pressed"]
    assert mode(foreign, "FAULT") == {
        "level": 2,
        "hardware_id": "cart",
        "mode": "FAULT",
        "reason": "stop was pressed",
    }
    assert foreign("call", service="/model/arm") == [False, "clear the fault first: stop was pressed"]
    assert foreign("call", service="/model/clear_fault") == [True, "DISARMED: fault cleared"]
    assert mode(foreign, "DISARMED")["reason"] == "fault cleared"
    assert foreign("call", service="/model/arm") == [True, "ARMED: asked to arm"]
    assert foreign("call", service="/model/disarm") == [True, "DISARMED: asked to disarm"]


@pytest.mark.usefixtures("armed")
def test_a_disarmed_robot_takes_no_setpoint(foreign: Ask) -> None:
    foreign("call", service="/model/disarm")
    before = int(setpoints_told(foreign).get("refused.not_armed", 0))
    assert foreign("publish", topic="/cmd_vel", kind="Twist", linear=0.5, angular=0.0)
    after = diagnostics(foreign, lambda a: int(a["cart: set-points"].get("refused.not_armed", 0)) > before)

    assert after["cart: mode"]["mode"] == "DISARMED"
    assert abs(newest(foreign, "/odom")["linear"]) < 0.01


@pytest.mark.usefixtures("armed")
def test_a_namespace_keeps_robots_apart(foreign: Ask) -> None:
    drive_until(foreign, 0.5, 0.0, lambda odom: odom["linear"] > 0.45, "/robot1")

    assert abs(newest(foreign, "/odom")["linear"]) < 0.01
    assert foreign("call", service="/robot1/model/stop") == [True, "FAULT: stop was pressed"]
    assert foreign("call", service="/model/arm") == [True, "armed already"]


BEST_EFFORT = (
    "segway-ecc: /foreign publishes /robot1/cmd_vel best-effort, and we ask for reliable: they never meet. "
    "Set its reliability to reliable"
)
WRONG_TYPE = (
    "segway-ecc: /foreign publishes std_msgs/msg/String on /robot1/cmd_vel_stamped, which takes "
    "geometry_msgs/msg/TwistStamped: they never meet. Publish geometry_msgs/msg/TwistStamped, or remap it away"
)


@pytest.mark.parametrize(
    ("offer", "expected"),
    [
        ({"topic": "/robot1/cmd_vel", "kind": "Twist", "best_effort": True}, BEST_EFFORT),
        ({"topic": "/robot1/cmd_vel_stamped", "kind": "String", "best_effort": False}, WRONG_TYPE),
    ],
    ids=["best-effort", "wrong type"],
)
def test_an_incompatible_publisher_is_reported_once_with_the_fix(
    foreign: Ask, messages: Path, offer: dict[str, Any], expected: str
) -> None:
    assert foreign("advertise", **offer)
    text = messages / "robot1.txt"
    for _ in range(TRIES):
        foreign("receive", topic="/robot1/odom")
        if expected in text.read_text().splitlines():
            break
    # The robot looks at a topic every half second: two more diagnostics, and it has looked again.
    foreign("receive", topic="/robot1/diagnostics")
    for _ in range(2):
        foreign("receive", topic="/robot1/diagnostics")

    assert text.read_text().splitlines().count(expected) == 1


def test_the_mode_is_published_and_a_heartbeat_is_echoed(foreign: Ask) -> None:
    foreign("call", service="/robot1/model/clear_fault")
    foreign("call", service="/robot1/model/disarm")
    message = receive_until(foreign, "/robot1/mode", lambda mode: mode["reason"] == "asked to disarm")
    assert message == {
        "level": 0,
        "name": "cart: mode",
        "hardware_id": "cart",
        "mode": "DISARMED",
        "reason": "asked to disarm",
        "cycle": message["cycle"],
        "drives": "none",
        "zero": "true",
        "heartbeat": "",
        "heartbeat_age_ms": "",
        "introduced": "",
        "stand": "",
        "posture": "",
    }
    name = "b\u00e4se" + 100 * "!"

    def is_echoed(mode: Any) -> bool:
        # Sent again until it is: the topic is best effort, and one that is sent early may be lost.
        foreign("beat", topic="/robot1/station", station=name, stamp_ns=5_000_000_007)
        return bool(mode["heartbeat"])

    echoed = receive_until(foreign, "/robot1/mode", is_echoed)
    assert echoed["heartbeat"] == "b\u00e4se" + 76 * "!" + " 5000000007"
    assert float(echoed["heartbeat_age_ms"]) >= 0.0
    foreign("call", service="/robot1/model/stop")
    stopped = receive_until(foreign, "/robot1/mode", lambda mode: mode["mode"] == "FAULT")
    assert (stopped["level"], stopped["reason"]) == (2, "stop was pressed")
    foreign("call", service="/robot1/model/clear_fault")
