# SPDX-License-Identifier: MIT
"""What the page that plays a log is sent of it; every struct is JSON. Times are seconds since the log's first cycle."""

from collections.abc import Sequence

import msgspec


class LogEventView(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened.

    Attributes:
        time_s: When, s.
        cycle: The number of the cycle that it was recorded with.
        kind: `mode`, `posture`, `fault`, `link`, `warning`, `request`, `parameter`, `station`, `trajectory`.
        name: The mode or posture that was entered; of any other kind empty.
        text: What happened, or why.
        level: `info`, `warning` or `error`.
    """

    time_s: float
    cycle: int
    kind: str
    text: str
    name: str = ""
    level: str = "info"


class LogView(msgspec.Struct, frozen=True, kw_only=True):
    """A log as a whole.

    Attributes:
        begin_ns: Stamp of its first cycle, ns since the Unix epoch, which names this content of the file.
        duration_s: From the first cycle to the last, s.
        period_s: Of the loop, s.
        cycles: How many are there.
        part: Which file of the run it is, from 1.
        has_end: Whether the end of the run is in it.
        is_cut: Whether the file has no proper end: it is being written, or power was cut.
        damage: What is damaged, a text for each place.
        gaps: From when to when nothing was recorded, s.
        events: In the order of time.
        events_left_off: How many more there are than are given.
        piece_s: So many seconds of whole cycles are given at a time.
        modes: The modes by the numbers that rows have.
        is_balancing: Whether the robot has a posture.
        tilt_limit_rad: Beyond that tilt safety takes the torque; None for any.
        down_rad: Beyond that tilt a robot that balances counts as fallen; None where it has no posture.
    """

    robot: str
    begin_ns: int
    duration_s: float
    period_s: float
    cycles: int
    part: int
    has_end: bool
    is_cut: bool
    damage: Sequence[str]
    gaps: Sequence[tuple[float, float]]
    events: Sequence[LogEventView]
    events_left_off: int
    piece_s: float
    modes: Sequence[str]
    is_balancing: bool
    tilt_limit_rad: float | None
    down_rad: float | None


class LogRowsView(msgspec.Struct, frozen=True, kw_only=True):
    """Cycles as columns of equal length; None is what was not recorded, or is not known.

    Where something is missing between two cycles, a row of None stands between them. Where there are more cycles than
    rows are wanted, two rows stand for many cycles: the smallest and then the largest value of each column; the number
    of the cycle is None then.

    Attributes:
        begin_ns: As in `LogView`.
        per: How many cycles two rows stand for at most; 1 where each cycle has a row.
        time_s: s.
        cycle: Its number.
        mode: Its mode, by its place in `LogView.modes`.
        is_off: Whether every drive reported that it is off.
        x: m.
        y: m.
        heading: rad.
        pitch: Forward lean, rad.
        linear_velocity: m/s.
        angular_velocity: rad/s.
        linear_setpoint: m/s.
        angular_setpoint: rad/s.
        supply_v: V.
    """

    begin_ns: int
    per: int
    time_s: Sequence[float]
    cycle: Sequence[int | None]
    mode: Sequence[int | None]
    is_off: Sequence[bool | None]
    x: Sequence[float | None]
    y: Sequence[float | None]
    heading: Sequence[float | None]
    pitch: Sequence[float | None]
    linear_velocity: Sequence[float | None]
    angular_velocity: Sequence[float | None]
    linear_setpoint: Sequence[float | None]
    angular_setpoint: Sequence[float | None]
    supply_v: Sequence[float | None]
