# SPDX-License-Identifier: MIT
"""The loop that a user would write: rclpy's timer and executor, python-can, the model through ctypes.

It stands alone: nothing of this package is used, so that it can be read, run and changed by itself.

    cp -r node/models/cart_submodel model; cp hil/bench/controller/* model
    cc -O2 -ffp-contract=off -shared -fPIC -o controller.so model/*.c -lm
    python user_loop.py --model controller.so --interface socketcan --channel vcan0 --period 0.01 --duration 10

It is written with care, for it is what our own loop is compared with: everything is made once and filled anew in each
cycle, one stamp serves all messages, the CRC comes from a table, no frame is waited for, and nothing is logged.
"""

import argparse
import array
import contextlib
import ctypes
import math
import socket
import struct
import time
from pathlib import Path

import can
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import BatteryState, Imu, JointState
from std_msgs.msg import Float64

COMMAND, LEFT_WHEEL, RIGHT_WHEEL, GYRO, ACCELERATION, STATUS = 0x110, 0x120, 0x121, 0x122, 0x123, 0x130
COMMAND_BODY = struct.Struct("<hhBxB")
WHEEL_BODY = struct.Struct("<ih")
AXES_BODY = struct.Struct("<hhh")
STATUS_BODY = struct.Struct("<BH")
MAX_VOLTAGE = 30.0
OFF_CYCLES = 20  # a board whose watchdog switched it off is left off by commands that do not enable
INPUTS, OUTPUTS = 4, 7
FRAME_LENGTH = 8
MOST_LOST = 5  # frames in a row that may be missing


def crc_table() -> bytes:
    """The table of CRC-8H2F."""
    table = []
    for value in range(256):
        entry = value
        for _ in range(8):
            entry = (entry << 1) ^ (0x2F if entry & 0x80 else 0)
        table.append(entry & 0xFF)
    return bytes(table)


CRC_TABLE = crc_table()


def crc(identifier: int, body: bytes | bytearray) -> int:
    """The CRC of a frame: its first seven bytes, then its identifier, low byte first."""
    total = 0xFF
    for byte in body:
        total = CRC_TABLE[total ^ byte]
    total = CRC_TABLE[total ^ (identifier & 0xFF)]
    return CRC_TABLE[total ^ (identifier >> 8)] ^ 0xFF


class CartNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Reads the wheel board, steps the model, commands the motors and publishes, once per period."""

    def __init__(self, options: argparse.Namespace, bus: can.BusABC, model: ctypes.CDLL) -> None:
        super().__init__("user_loop", namespace=options.namespace or None)
        self.bus = bus
        self.model = model
        self.u = (ctypes.c_double * INPUTS)()
        self.y = (ctypes.c_double * OUTPUTS)()
        self.model.XXInitializeSubmodel(self.u, self.y, 0.0)
        self.period_ns = round(options.period * 1e9)
        self.cycle = 0
        self.wheels = {LEFT_WHEEL: (0.0, 0.0), RIGHT_WHEEL: (0.0, 0.0)}
        self.axes = {GYRO: (0.0, 0.0, 0.0), ACCELERATION: (0.0, 0.0, 0.0)}
        self.state = 0
        self.voltage = math.nan
        self.counters: dict[int, int] = {}
        self.refused = 0
        self.guard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.guard_address = "\0" + options.guard
        self.samples = array.array("q")
        self.make_topics()
        self.subscription = self.create_subscription(Twist, "cmd_vel", self.on_cmd_vel, 10)
        self.first_ns = time.monotonic_ns() + self.period_ns
        self.last_ns = self.first_ns + round(options.duration * 1e9) - self.period_ns
        self.timer = self.create_timer(options.period, self.on_timer)

    def make_topics(self) -> None:
        """The topics, each with its message."""
        self.linear = self.create_publisher(Float64, "linear_velocity", 10), Float64()
        self.angular = self.create_publisher(Float64, "angular_velocity", 10), Float64()
        self.position = self.create_publisher(Point, "position", 10), Point()
        odometry, joints, imu, battery = Odometry(), JointState(), Imu(), BatteryState()
        odometry.header.frame_id, odometry.child_frame_id = "odom", "base_link"
        joints.name = ["left_wheel_joint", "right_wheel_joint"]
        imu.header.frame_id = "imu_link"
        imu.orientation_covariance[0] = -1.0
        battery.present = True
        self.odometry = self.create_publisher(Odometry, "odom", 10), odometry
        self.joints = self.create_publisher(JointState, "joint_states", 10), joints
        self.imu = self.create_publisher(Imu, "imu/data", 10), imu
        self.battery = self.create_publisher(BatteryState, "battery_state", 10), battery
        mode = DiagnosticStatus(name="user_loop", values=[KeyValue(key="state"), KeyValue(key="cycle")])
        self.mode = self.create_publisher(DiagnosticStatus, "mode", 10), mode

    def on_cmd_vel(self, twist: Twist) -> None:
        """Take a set-point."""
        if math.isfinite(twist.linear.x) and math.isfinite(twist.angular.z):
            self.u[0], self.u[1] = twist.linear.x, twist.angular.z

    def on_timer(self) -> None:
        """One cycle."""
        start_ns, cpu_ns = time.monotonic_ns(), time.thread_time_ns()
        self.receive()
        received_ns = time.monotonic_ns()
        self.u[2], self.u[3] = self.wheels[LEFT_WHEEL][1], self.wheels[RIGHT_WHEEL][1]
        self.model.XXCalculateSubmodel(self.u, self.y, self.cycle * self.period_ns * 1e-9)
        stepped_ns = time.monotonic_ns()
        self.send()
        sent_ns = time.monotonic_ns()
        self.publish()
        end_ns = time.monotonic_ns()
        deadline_ns = start_ns - (start_ns - self.first_ns) % self.period_ns
        bus_ns = received_ns - start_ns + sent_ns - stepped_ns
        self.samples.extend(
            (deadline_ns, start_ns, cpu_ns, bus_ns, stepped_ns - received_ns, end_ns - sent_ns, end_ns - start_ns)
        )
        self.cycle += 1
        if deadline_ns >= self.last_ns:
            raise SystemExit

    def receive(self) -> None:
        """Take every frame that has arrived; what is damaged is counted and passed over."""
        while (message := self.bus.recv(timeout=0)) is not None:
            identifier, data = message.arbitration_id, message.data
            if len(data) != FRAME_LENGTH or crc(identifier, data[:7]) != data[7]:
                self.refused += 1
                continue
            counter = data[6] & 0x0F
            if not 1 <= (counter - self.counters.get(identifier, counter - 1)) % 16 <= MOST_LOST + 1:
                self.refused += 1
            self.counters[identifier] = counter
            if identifier in self.wheels:
                angle, velocity = WHEEL_BODY.unpack_from(data)
                self.wheels[identifier] = (angle * 1e-4, velocity * 1e-2)
            elif identifier in self.axes:
                unit = 1e-3 if identifier == GYRO else 5e-3
                x, y, z = AXES_BODY.unpack_from(data)
                self.axes[identifier] = (x * unit, y * unit, z * unit)
            elif identifier == STATUS:
                state, millivolts = STATUS_BODY.unpack_from(data)
                self.state, self.voltage = state & 7, millivolts * 1e-3

    def send(self) -> None:
        """Command the motors, and send the guard its heartbeat."""
        enable = self.cycle >= OFF_CYCLES
        left, right = (max(-MAX_VOLTAGE, min(MAX_VOLTAGE, volts)) if enable else 0.0 for volts in self.y[5:7])
        body = COMMAND_BODY.pack(round(left * 1e3), round(right * 1e3), enable, self.cycle % 16)
        data = body + bytes((crc(COMMAND, body),))
        self.bus.send(can.Message(arbitration_id=COMMAND, data=data, is_extended_id=False))
        with contextlib.suppress(OSError):  # there may be no guard
            self.guard.sendto(b"\1" if enable else b"\0", socket.MSG_DONTWAIT, self.guard_address)

    def publish(self) -> None:
        """Publish the topics of this cycle."""
        x, y, heading, linear, angular, _, _ = self.y
        stamp = self.get_clock().now().to_msg()
        for (publisher, message), value in ((self.linear, linear), (self.angular, angular)):
            message.data = value
            publisher.publish(message)
        publisher, point = self.position
        point.x, point.y = x, y
        publisher.publish(point)
        publisher, odometry = self.odometry
        odometry.header.stamp = stamp
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = x, y
        orientation = odometry.pose.pose.orientation
        orientation.z, orientation.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = linear, angular
        publisher.publish(odometry)
        self.publish_measured(stamp)
        if self.cycle * self.period_ns % 100_000_000 < self.period_ns:
            self.publish_slow(stamp)

    def publish_measured(self, stamp: object) -> None:
        """Publish wheels and IMU."""
        (left, left_velocity), (right, right_velocity) = self.wheels[LEFT_WHEEL], self.wheels[RIGHT_WHEEL]
        publisher, joints = self.joints
        joints.header.stamp = stamp
        joints.position, joints.velocity = [left, right], [left_velocity, right_velocity]
        publisher.publish(joints)
        publisher, imu = self.imu
        imu.header.stamp = stamp
        rate, force = imu.angular_velocity, imu.linear_acceleration
        rate.x, rate.y, rate.z = self.axes[GYRO]
        force.x, force.y, force.z = self.axes[ACCELERATION]
        publisher.publish(imu)

    def publish_slow(self, stamp: object) -> None:
        """Publish what ten times a second is enough for."""
        publisher, mode = self.mode
        mode.message = f"board state {self.state}"
        mode.values[0].value, mode.values[1].value = str(self.state), str(self.cycle)
        publisher.publish(mode)
        publisher, battery = self.battery
        battery.header.stamp = stamp
        battery.voltage = self.voltage
        publisher.publish(battery)


def load(path: Path) -> ctypes.CDLL:
    """The model as 20-sim's C interface offers it."""
    model = ctypes.CDLL(str(path))
    numbers = ctypes.POINTER(ctypes.c_double)
    model.XXInitializeSubmodel.argtypes = (numbers, numbers, ctypes.c_double)
    model.XXCalculateSubmodel.argtypes = (numbers, numbers, ctypes.c_double)
    model.XXInitializeSubmodel.restype = model.XXCalculateSubmodel.restype = None
    return model


def main(settings: contextlib.AbstractContextManager[object] | None = None) -> None:
    """Run for as long as was asked for, then write the samples.

    `settings` are in force while it spins, such as a scheduling of this thread; none where it is run by itself.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--interface", default="socketcan")
    parser.add_argument("--channel", default="vcan0")
    parser.add_argument("--period", type=float, default=0.01)
    parser.add_argument("--duration", type=float, default=10.0)
    parser.add_argument("--namespace", default="")
    parser.add_argument("--guard", default="user-loop-guard")
    parser.add_argument("--samples", type=Path)
    options = parser.parse_args()
    rclpy.init()
    with can.Bus(interface=options.interface, channel=options.channel) as bus:
        node = CartNode(options, bus, load(options.model))
        with settings or contextlib.nullcontext(), contextlib.suppress(SystemExit):
            rclpy.spin(node)
        if options.samples:
            options.samples.write_bytes(node.samples.tobytes())
        node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
