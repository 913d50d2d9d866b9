# SPDX-License-Identifier: MIT
"""A recorded run as arrays: what was measured and when, and what was sent."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.replay.recorded import RecordedRun

Array = npt.NDArray[np.float64]
_NS: Final = 1e-9
PITCH: Final = "pitch"
"""Not measured: the model's estimate, of a robot that has one."""
_PITCH_SOURCE: Final = "topic.pitch"
_PITCH_AGES_AS: Final = "imu.angular_velocity_y"


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """The cycles of a log in which the drives followed commands and all was measured.

    Attributes:
        file: The robot file that was in force.
        period_s: Of the loop, s.
        cycles: Their numbers, shape (n,).
        starts: When each started, s since the log's first cycle, shape (n,).
        commands: What was sent in the exchange of each cycle, shape (n, number of commands), in the commands' units.
        command_names: Of the commands, in that order.
        values: What each signal was, shape (n,), SI.
        times: When that arrived, as `starts`, shape (n,).
        damage: What is damaged or missing in the log.
    """

    file: RobotFile
    period_s: float
    cycles: npt.NDArray[np.int64]
    starts: Array
    commands: Array
    command_names: tuple[str, ...]
    values: Mapping[str, Array]
    times: Mapping[str, Array]
    damage: tuple[str, ...]

    @property
    def stretches(self) -> list[tuple[int, int]]:
        """Where cycles follow each other without a gap: the first place of each, and the one behind its last."""
        gaps = np.flatnonzero(np.diff(self.cycles) != 1) + 1
        edges = [0, *gaps.tolist(), len(self.cycles)]
        return list(itertools.pairwise(edges))


def read_run(path: Path, begin_s: float = 0.0, end_s: float = np.inf) -> LoggedRun:
    """Read a log, or the part of it between two times, s since its first cycle.

    Raises:
        RecordingError: It cannot be read, holds no commands, or the drives follow none in that part.
    """
    run = RecordedRun(path)
    layout = run.layout
    if not layout.commands:
        raise RecordingError(f"{path} cannot be compared: robot '{layout.robot}' sends no commands, it is all model")
    kept: list[CycleRecord] = []
    sent: list[tuple[float, ...]] = []
    first_ns: int | None = None
    before: CycleRecord | None = None
    for record in run.cycles():
        first_ns = record.start_ns if first_ns is None else first_ns
        # Commands that were computed in one cycle leave in the exchange of the next, unless they leave at once.
        leaves = record if run.robot.actuate == "immediately" else before
        is_joined = leaves is record or (before is not None and before.cycle == record.cycle - 1)
        before = record
        if not begin_s <= (record.start_ns - first_ns) * _NS <= end_s:
            continue
        if leaves is not None and is_joined and record.sensors.ready and all(record.sensors.valid):
            kept.append(record)
            sent.append(tuple(leaves.commands))
    if first_ns is None or not kept:
        raise RecordingError(f"{path} cannot be compared: in no cycle of it do the drives follow commands")
    starts = np.array([(record.start_ns - first_ns) * _NS for record in kept])
    measured = np.array([record.sensors.values for record in kept])
    arrived = starts[:, None] - np.array([record.sensors.ages for record in kept])
    values = {name: measured[:, place] for place, name in enumerate(layout.sensors)}
    times = {name: arrived[:, place] for place, name in enumerate(layout.sensors)}
    port = next((port for port, signal in run.robot.wiring.items() if signal == _PITCH_SOURCE), None)
    if port in layout.outputs and _PITCH_AGES_AS in times:
        place = layout.outputs.index(str(port))
        values[PITCH] = np.array([record.y[place] for record in kept])
        times[PITCH] = times[_PITCH_AGES_AS]
    damage = [*run.damage, *(f"cycles {first} to {last} are missing in the log" for first, last in run.missing)]
    if run.is_cut:
        damage.append("the log ends before its time, as after a power cut or a killed node: compared up to there")
    return LoggedRun(
        file=run.robot,
        period_s=layout.period_ns * _NS,
        cycles=np.array([record.cycle for record in kept]),
        starts=starts,
        commands=np.array(sent),
        command_names=layout.commands,
        values=values,
        times=times,
        damage=tuple(damage),
    )
