# SPDX-License-Identifier: MIT
"""Robots that are not there: they speak as the model node does, and do what they are reported on standard input.

Started with namespaces; each robot is a ROS participant of its own. Reads one JSON object per line, answers each with
one JSON value: `{"robot": "/a", "set": {...}}` changes attributes, `{"robot": "/a", "get": "received"}` reads one.
"""

import argparse
import contextlib
import heapq
import json
import math
import os
import struct
import sys
import time
import zlib
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from segway_ecc.node.ros.runtime import ros_node

ACTIONS = ("arm", "disarm", "stop", "clear_fault", "stand_up", "sit_down")
TIMEOUT_S = 0.5
NOT_RAW = False
NS_PER_S = 1_000_000_000
DIAGNOSTICS = {
    "timing": {"rate_hz": "100.0012", "wanted_rate_hz": "100", "late": "0", "cycle": "p50 1 us, p99 2 us"},
    "set-points": {"applied": "0", "late": "0"},
    "hardware": {
        "link": "can can0, serial /dev/ttyS0",
        "link.owner": "can",
        "link.can.state": "active",
        "link.can.sent_per_s": "200.0",
        "link.serial.state": "passive",
        "link.serial.refused.crc": "3",
        "board.bus_voltage_v": "24.1",
    },
}


def pairs(values: dict[str, str]) -> list[Any]:
    return [KeyValue(key=key, value=value) for key, value in values.items()]


def never_called(*_: Any) -> None:
    pass


class FakeRobot:
    def __init__(self, node: Any, name: str) -> None:
        self.node, self.name = node, name
        self.mode, self.reason, self.drives, self.zero = "DISARMED", "just started", "off", True
        self.refuses = ""
        self.posture = "BALANCING"
        self.is_deaf = self.serves_not = False
        self.drives_stay_on = self.drives_fall_silent = False
        self.checks = {"check.rate": "ok: 100.00 Hz of 100 Hz", "check.tilt": "refused: 1.00 rad from upright"}
        self.received: list[Any] = []
        self.beat, self.beat_ns = "", 0
        self.setpoint, self.setpoint_ns = (0.0, 0.0), 0
        self.waiting: list[tuple[int, float, float]] = []
        self.x = 0.0
        self.reported: tuple[Any, ...] = ()
        self.mode_ns = self.diagnostics_ns = self.then_ns = 0
        self.mode_out = node.create_publisher(DiagnosticStatus, "mode", 10)
        self.odometry_out = node.create_publisher(Odometry, "odom", 10)
        self.odometry = Odometry()
        self.setpoint_out = node.create_publisher(TwistStamped, "setpoint", 500)
        self.trajectory_out = node.create_publisher(DiagnosticStatus, "trajectory_status", 10)
        self.trajectory, self.trajectory_reported = (0, 0), (0, "")
        self.digest = 0
        self.pitch_out = node.create_publisher(Float64, "pitch", 10)
        self.battery_out = node.create_publisher(BatteryState, "battery_state", 10)
        self.diagnostics_out = node.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.ins = [
            node.create_subscription(kind, topic, never_called, depth)
            for kind, topic, depth in (
                (Twist, "cmd_vel", 10),
                (MultiDOFJointTrajectory, "cmd_trajectory", 10),
                (Header, "station", 1),
            )
        ]
        self.services = {action: node.create_service(Trigger, f"~/{action}", never_called) for action in ACTIONS}

    def cycle(self) -> None:
        now_ns = time.time_ns()
        for index, subscription in enumerate(self.ins):
            while (taken := subscription.handle.take_message(subscription.msg_type, NOT_RAW)) is not None:
                if not self.is_deaf:
                    self.hear(index, taken[0], now_ns)
        self.serve()
        self.follow(now_ns)
        self.publish(now_ns)
        self.then_ns = now_ns

    def hear(self, index: int, message: Any, now_ns: int) -> None:
        at = time.monotonic()
        if index == 0:
            self.received.append(["drive", at, message.linear.x, message.angular.z])
            heapq.heappush(self.waiting, (now_ns, message.linear.x, message.angular.z))
        elif index == 1:
            self.take_trajectory(message, at, now_ns)
        else:
            stamp = message.stamp.sec * NS_PER_S + message.stamp.nanosec
            self.beat, self.beat_ns = f"{message.frame_id} {stamp}", now_ns

    def take_trajectory(self, message: Any, at: float, now_ns: int) -> None:
        """Accept a trajectory as it is, each of its set-points renewed ten times a second."""
        stamp = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
        points = [
            (
                p.time_from_start.sec * NS_PER_S + p.time_from_start.nanosec,
                p.velocities[0].linear.x,
                p.velocities[0].angular.z,
            )
            for p in message.points
        ]
        self.received.append(["follow", at, *(number for point in points for number in point[1:])])
        self.waiting.clear()
        if not points:
            heapq.heappush(self.waiting, (now_ns, 0.0, 0.0))
            self.trajectory = (self.trajectory[0], now_ns)
            return
        for (begin, linear, angular), (end, *_) in zip(points, [*points[1:], (points[-1][0] + 1,)], strict=True):
            for offset in range(begin, end, NS_PER_S // 10):
                heapq.heappush(self.waiting, (stamp + offset, linear, angular))
        self.trajectory = (stamp, stamp + points[-1][0])
        numbers = (number for point in points for number in point)
        self.digest = zlib.crc32(struct.pack(f"<q{'qdd' * len(points)}", stamp, *numbers))

    def publish_trajectory(self, now_ns: int) -> None:
        start, end = self.trajectory
        state = "none" if not start else "accepted" if now_ns < start else "done" if now_ns >= end else "followed"
        if (start, state) != self.trajectory_reported:
            self.trajectory_reported = (start, state)
            values = {"stamp_ns": start, "state": state, "reason": "", "start_ns": start, "end_ns": end, "cycles": 1}
            values["digest"] = self.digest
            pairs_ = pairs({key: str(value) for key, value in values.items()})
            self.trajectory_out.publish(DiagnosticStatus(level=b"\0", name=f"{self.name}: trajectory", values=pairs_))

    def serve(self) -> None:
        for action, service in self.services.items():
            request, header = service.handle.service_take_request(Trigger.Request)
            if request is None or self.is_deaf or self.serves_not:
                continue
            self.received.append([action, time.monotonic()])
            accepted, text = (False, self.refuses) if self.refuses else (True, self.obey(action))
            service.handle.service_send_response(Trigger.Response(success=accepted, message=text), header.request_id)

    def obey(self, action: str) -> str:
        if action in {"stand_up", "sit_down"}:
            self.posture = {"stand_up": "STANDING UP", "sit_down": "SITTING DOWN"}[action]
            return f"the robot is {self.posture}"
        mode, reason = {
            "arm": ("ARMED", "asked to arm"),
            "disarm": ("DISARMED", "asked to disarm"),
            "stop": ("FAULT", "stop was pressed"),
            "clear_fault": ("DISARMED", "fault cleared"),
        }[action]
        is_on = mode == "ARMED" or self.drives_stay_on
        self.mode, self.reason, self.zero = mode, reason, not is_on
        self.drives = "on" if is_on else "unconfirmed" if self.drives_fall_silent else "off"
        self.waiting.clear()
        self.setpoint, self.setpoint_ns = (0.0, 0.0), time.time_ns()
        return f"{mode}: {reason}"

    def follow(self, now_ns: int) -> None:
        while self.waiting and self.waiting[0][0] <= now_ns:
            stamp, *setpoint = heapq.heappop(self.waiting)
            if self.mode in {"ARMED", "HOLD"}:
                self.mode = "ARMED"
                self.setpoint, self.setpoint_ns = (setpoint[0], setpoint[1]), now_ns
                out = TwistStamped()
                out.header.stamp.sec, out.header.stamp.nanosec = divmod(stamp, NS_PER_S)
                out.twist.linear.x, out.twist.angular.z = setpoint
                self.setpoint_out.publish(out)
        if self.mode == "ARMED" and now_ns - self.setpoint_ns > TIMEOUT_S * NS_PER_S:
            self.mode, self.reason, self.setpoint = "HOLD", "no set-point arrives any more", (0.0, 0.0)
        self.x += self.setpoint[0] * (now_ns - self.then_ns if self.then_ns else 0) / NS_PER_S

    def publish(self, now_ns: int) -> None:
        message = self.odometry
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, NS_PER_S)
        message.pose.pose.position.x = self.x
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(0.25), math.cos(0.25)
        message.twist.twist.linear.x, message.twist.twist.angular.z = self.setpoint
        self.odometry_out.publish(message)
        self.publish_trajectory(now_ns)
        self.pitch_out.publish(Float64(data=0.05))
        reported = (self.mode, self.reason, self.drives, self.posture)
        if reported != self.reported or now_ns - self.mode_ns >= 0.1 * NS_PER_S:
            self.reported, self.mode_ns = reported, now_ns
            self.mode_out.publish(self.mode_message(now_ns))
        if now_ns - self.diagnostics_ns >= NS_PER_S:
            self.diagnostics_ns = now_ns
            self.publish_diagnostics()

    def mode_message(self, now_ns: int) -> Any:
        values = {
            "mode": self.mode,
            "reason": self.reason,
            "cycle": "1",
            "drives": self.drives,
            "zero": str(self.zero).lower(),
            "heartbeat": self.beat,
            "heartbeat_age_ms": f"{(now_ns - self.beat_ns) / 1e6:.3f}" if self.beat else "",
            "posture": self.posture,
        }
        text = f"{self.mode}: {self.reason}"
        return DiagnosticStatus(level=b"\0", name=f"{self.name}: mode", message=text, values=pairs(values))

    def publish_diagnostics(self) -> None:
        parts = {"mode": {"mode": self.mode, "reason": self.reason, **self.checks}, **DIAGNOSTICS}
        array = DiagnosticArray()
        array.status = [
            DiagnosticStatus(level=b"\0", name=f"{self.name}: {part}", values=pairs(values))
            for part, values in parts.items()
        ]
        self.diagnostics_out.publish(array)
        self.battery_out.publish(BatteryState(voltage=24.5))


def answer(robots: dict[str, FakeRobot], line: str) -> Any:
    question = json.loads(line)
    robot = robots[question["robot"]]
    for name, value in question.get("set", {}).items():
        setattr(robot, name, value)
    return getattr(robot, question["get"]) if "get" in question else None


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("namespaces", nargs="+")
    parser.add_argument("--rate", type=float, default=100.0)
    options = parser.parse_args()
    os.set_blocking(sys.stdin.fileno(), False)
    with contextlib.ExitStack() as stack:
        robots = {
            space: FakeRobot(stack.enter_context(ros_node("model", space)), space.strip("/") or "alone")
            for space in options.namespaces
        }
        pending, deadline = "", time.monotonic()
        while True:
            for robot in robots.values():
                robot.cycle()
            deadline = max(deadline + 1.0 / options.rate, time.monotonic() - 1.0)
            time.sleep(max(deadline - time.monotonic(), 0.0))
            with contextlib.suppress(BlockingIOError):
                data = os.read(0, 65536)
                if not data:
                    return
                pending += data.decode()
            *lines, pending = pending.split("\n")
            for line in lines:
                sys.stdout.write(json.dumps(answer(robots, line)) + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
