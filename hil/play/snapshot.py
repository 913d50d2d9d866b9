"""What the terminal shows, as it passes from the loop's process to the terminal's."""

import msgspec


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one moment.

    Attributes:
        robot: Its name.
        mode: What it is allowed to do.
        reason: Why it entered that mode.
        linear: Linear velocity ahead, m/s; None where the robot does not publish it.
        angular: Angular velocity, counter-clockwise, rad/s; None where the robot does not publish it.
        wanted_linear: Set-point in force, m/s.
        wanted_angular: Set-point in force, rad/s.
        pitch: Tilt, positive ahead, rad; None where the robot has none.
        posture: What it is doing, where it is one that stands up and sits down; else None.
        battery: Supply voltage, V, by drive.
        links: State of each line to the drives, by its name; empty where there is none.
        line: The line that carries the commands, where there are two; else None.
        timing: How the loop meets its deadlines.
        messages: The last notices, oldest first.
        has_ros: Whether ROS reaches the robot.
        guard_runs: Whether the guard runs.
        can_be_pushed: Whether the plant can be pushed.
        is_bus_broken: Whether the bus was broken by hand.
    """

    robot: str
    mode: str
    reason: str
    linear: float | None
    angular: float | None
    wanted_linear: float
    wanted_angular: float
    pitch: float | None
    posture: str | None
    battery: dict[str, str]
    links: dict[str, str]
    line: str | None
    timing: dict[str, str]
    messages: list[str]
    has_ros: bool
    guard_runs: bool
    can_be_pushed: bool
    is_bus_broken: bool
