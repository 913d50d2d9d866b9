"""What the terminal shows, as it passes from the loop's process to the terminal's."""

import msgspec


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one moment.

    Attributes:
        robot: Its name.
        mode: What it is allowed to do.
        reason: Why it entered that mode.
        linear: Linear velocity ahead, m/s; None where the robot does not tell it.
        angular: Angular velocity, counter-clockwise, rad/s; None where the robot does not tell it.
        wanted_linear: Set-point in force, m/s.
        wanted_angular: Set-point in force, rad/s.
        pitch: Tilt, positive ahead, rad; None where the robot has none.
        battery: Supply voltage, V, by drive.
        links: State of each line to the drives.
        timing: How the loop meets its deadlines.
        messages: What was told last, oldest first.
        has_ros: Whether ROS reaches the robot.
        has_guard: Whether a guard runs.
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
    battery: dict[str, str]
    links: dict[str, str]
    timing: dict[str, str]
    messages: list[str]
    has_ros: bool
    has_guard: bool
    can_be_pushed: bool
    is_bus_broken: bool
