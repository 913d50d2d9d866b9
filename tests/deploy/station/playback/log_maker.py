# SPDX-License-Identifier: MIT
"""Logs of a robot that leans and drives as a test says."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord, PostureChange
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout, LogPart, Provenance
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

PERIOD_NS: Final = 5_000_000
BEGIN_NS: Final = 1_700_000_000_000_000_000
STARTED_NS: Final = 42_000_000_000
ROBOT: Final = {
    "name": "Alice",
    "wiring": {"Pitch": "topic.pitch", "X": "odometry.x", "Stand": "set.stand"},
    "safety": {"tilt_limit_rad": 0.8, "posture": {"down_rad": 0.4}},
}
LAYOUT: Final = CycleLayout(
    robot="Alice",
    published=ODOMETRY_SIGNALS,
    sensors=("left.angle",),
    inputs=("Stand",),
    outputs=("X", "Pitch"),
    commands=("left.voltage",),
    odometry_frame="odom",
    base_frame="base_link",
    imu_frame="imu_link",
    joints=("left_joint", "right_joint"),
    period_ns=PERIOD_NS,
)
CHUNK_CYCLES: Final = 100


def record(cycle: int, *, pitch: float | None = None, mode: Mode = Mode.ARMED, **fields: Any) -> CycleRecord:
    """A cycle of a robot that drives ahead at 0.5 m/s and sways."""
    t = cycle * PERIOD_NS * 1e-9
    made = CycleRecord(
        cycle,
        BEGIN_NS + cycle * PERIOD_NS,
        mode,
        lateness_ns=1000,
        sensors=Sensors((0.5,), (0.001,), (True,), off=False),
        setpoint=Setpoint(0.5, 0.0),
        u=(1.0,),
        y=(0.5 * t, 0.1 * math.sin(3.0 * t) if pitch is None else pitch),
        commands=(1.0,),
        published=(0.5 * t, 0.1 * math.sin(t), 0.0, 0.5, 0.0),
        durations_ns=(1, 2, 3, 4, 5),
        start_ns=STARTED_NS + cycle * PERIOD_NS,
    )
    return msgspec.structs.replace(made, **fields) if fields else made


def write_log(
    path: Path, records: Iterable[CycleRecord], *, is_end: bool = True, part: int = 1, layout: CycleLayout = LAYOUT
) -> Path:
    """A log of these cycles, with a chunk every half second and diagnostics every second, as on a robot."""
    attachments = {"robot.json": msgspec.json.encode(ROBOT).decode()}
    log = CycleLog(path, layout, Provenance(attachments, {}), LogPart("run", part))
    for count, each in enumerate(records, 1):
        log.write(each)
        if count % CHUNK_CYCLES == 0:
            log.flush()
        if count % (2 * CHUNK_CYCLES) == 0:
            values = {"mode": str(each.mode), "reason": f"why it is {each.mode}"}
            log.write_diagnostics(each.stamp_ns, [DiagnosticStatus(Level.OK, "Alice: mode", "", values)])
    log.close(is_end=is_end)
    return path


def story(seconds: float = 12.0) -> Sequence[CycleRecord]:
    """It is armed after 1 s, stands up, and falls at 9 s."""

    def at(moment_s: float) -> int:
        return round(moment_s * 1e9 / PERIOD_NS)

    happens: dict[int, dict[str, Any]] = {
        at(1.0): {"posture": PostureChange(Posture.STANDING_UP, "")},
        at(1.5): {"posture": PostureChange(Posture.BALANCING, "")},
        at(9.0): {"posture": PostureChange(Posture.FALLEN, "the body leans 0.81 rad, beyond 0.8 rad")},
    }

    def mode(cycle: int) -> Mode:
        return Mode.DISARMED if cycle < at(1.0) else Mode.FAULT if cycle >= at(9.0) else Mode.ARMED

    return [record(cycle, mode=mode(cycle), **happens.get(cycle, {})) for cycle in range(at(seconds))]
