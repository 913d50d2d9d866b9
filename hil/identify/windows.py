# SPDX-License-Identifier: MIT
"""Recorded runs as short windows of what was commanded and measured while the robot was off its bumpers."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import ConfigurationError, RecordingError
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.safety.modes import ACTIVE

SAMPLES: Final = 50
"""Of a window: 0.25 s at 200 Hz, in which a lean grows tenfold."""
LEAST_SAMPLES: Final = 12
HISTORY: Final = 6
"""Commands before a window that may still act in it."""
MOST_WINDOWS: Final = 240
_OFF_STOP: Final = 0.9
"""Part of the stop's angle beyond which bumpers may touch the ground."""
_SLOWEST: Final = 0.3
"""Of a wheel against the body, rad/s: where it nearly stands, friction is not what a simple law has."""
_REST_SAMPLES: Final = 40
_REST_SPEED: Final = 0.02
CHANNELS: Final = ("LeftAngle", "RightAngle", *(f"{kind}{axis}" for kind in ("Gyro", "Acceleration") for axis in "XYZ"))


class Run(NamedTuple):
    """One run, cycle by cycle.

    Attributes:
        period_s: Of the loop, s.
        commands: Of the left and the right wheel, V or N m, and 1 where they reach the motors, cycles by 3.
        measured: As `CHANNELS`, cycles by 8.
        pitch: As the model took it to be, rad.
        speeds: Of the wheels, rad/s, cycles by 2.
        usable: Whether everything measured was fresh, and no cycle is missing before.
    """

    period_s: float
    commands: Matrix
    measured: Matrix
    pitch: Matrix
    speeds: Matrix
    usable: "np.ndarray[tuple[int], np.dtype[np.bool_]]"


class Windows(NamedTuple):
    """Windows of one length, those that are shorter filled up and masked.

    Attributes:
        period_s: Of a sample, s.
        commands: Windows by `HISTORY` + samples by 3; the first sample's command is at `HISTORY`.
        measured: Windows by samples by channels.
        mask: Windows by samples: 1 where there is one.
        start: Windows by 6: v, q, w, pitch and the wheels' angles at the first sample, from what was measured.
        rest: Mean of the gyro's axes over each while of rest, whiles by 3.
    """

    period_s: float
    commands: Matrix
    measured: Matrix
    mask: Matrix
    start: Matrix
    rest: Matrix

    def chosen(self, places: Sequence[int]) -> "Windows":
        """Some of the windows."""
        at = list(places)
        return self._replace(
            commands=self.commands[at], measured=self.measured[at], mask=self.mask[at], start=self.start[at]
        )


def read_run(path: Path, skip_s: float = 0.0) -> tuple[Run, RobotFile]:
    """Read a log, without its first `skip_s` seconds.

    Raises:
        RecordingError: It is no log of a run, or of no robot that balances.
    """
    recorded = RecordedRun(path)
    return run_of(recorded.cycles(), recorded.layout, skip_s=skip_s, where=str(path)), recorded.robot


def run_of(records: Iterable[CycleRecord], layout: CycleLayout, *, skip_s: float = 0.0, where: str = "the run") -> Run:
    """Take what is needed of a run's cycles; the first `skip_s` seconds, in which a hand held it, are not usable.

    Raises:
        RecordingError: The run is empty, or of no robot that balances.
    """
    needed = (*CHANNELS, "LeftVelocity", "RightVelocity")
    lacking = [name for name in needed if name not in layout.inputs]
    if lacking or "Pitch" not in layout.outputs or len(layout.commands) < 2:  # noqa: PLR2004 - a left one and a right one
        raise RecordingError(f"{where} is of no segway: its model has no {', '.join(lacking) or 'output Pitch'}")
    places = [layout.inputs.index(name) for name in needed]
    pitch = layout.outputs.index("Pitch")
    sides = [next(i for i, name in enumerate(layout.commands) if name.startswith(side)) for side in ("left", "right")]
    rows, usable, expected = [], [], -1
    for record in records:
        active = float(record.mode in ACTIVE)
        sent = [record.commands[i] * active for i in sides]
        rows.append([*sent, active, *(record.u[i] for i in places), record.y[pitch]])
        usable.append(all(record.sensors.valid) and record.cycle == expected)
        expected = record.cycle + 1
    if not rows:
        raise RecordingError(f"{where} holds no cycles")
    table = np.array(rows, dtype=np.float64)
    usable_row = np.array(usable) & np.isfinite(table).all(axis=1)
    usable_row[: round(skip_s * 1e9 / layout.period_ns)] = False
    count = 3 + len(CHANNELS)
    return Run(
        layout.period_ns * 1e-9, table[:, :3], table[:, 3:count], table[:, -1], table[:, count : count + 2], usable_row
    )


def windows_of(runs: Sequence[Run], *, radius: float, stop_angle: float) -> Windows:
    """Cut runs into windows, those with the most motion where there are more than `MOST_WINDOWS`.

    Args:
        runs: At the same period.
        radius: Of the wheels, m, about: for where a window starts.
        stop_angle: At which bumpers touch the ground, rad.

    Raises:
        ConfigurationError: There is no window in which the robot was off its bumpers.
    """
    periods = {run.period_s for run in runs}
    if len(periods) != 1:
        raise ConfigurationError("the logs are of runs at different periods: identify from those of one period")
    parts, rest = [], []
    for run in runs:
        free = run.usable & (np.abs(run.pitch) < _OFF_STOP * stop_angle) & (np.abs(run.speeds).min(axis=1) > _SLOWEST)
        for first, end in _stretches(free):
            starts = range(max(first, HISTORY), end - LEAST_SAMPLES + 1, SAMPLES)
            parts += [_window(run, start, min(end, start + SAMPLES), radius) for start in starts]
        rest += [
            run.measured[first:end, 2:5].mean(axis=0)
            for first, end in _stretches(_rests(run))
            if end - first >= _REST_SAMPLES
        ]
    if not parts:
        raise ConfigurationError(
            f"the logs have no {LEAST_SAMPLES} cycles in a row in which the robot was off its bumpers: "
            "record it while it stands up"
        )
    commands, measured, mask, start = (np.array(column) for column in zip(*parts, strict=True))
    found = Windows(periods.pop(), commands, measured, mask, start, np.array(rest).reshape(-1, 3))
    if len(parts) <= MOST_WINDOWS:
        return found
    spread = (measured[:, :, 2:5].std(axis=1) / measured[:, :, 2:5].std()).sum(axis=1) * mask.mean(axis=1)
    return found.chosen(sorted(np.argsort(-spread, kind="stable")[:MOST_WINDOWS].tolist()))


def _stretches(flags: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> list[tuple[int, int]]:
    """First and end of each row of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _rests(run: Run) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    gyro = run.measured[:, 2:5]
    steady = np.abs(gyro - np.roll(gyro, 1, axis=0)).max(axis=1) < _REST_SPEED
    still = np.concatenate([[False], np.abs(np.diff(run.measured[:, :2], axis=0)).max(axis=1) == 0.0])
    return np.asarray(steady & still & (run.commands[:, :2] == 0.0).all(axis=1))


def _window(run: Run, start: int, end: int, radius: float) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    count = end - start
    measured = np.zeros((SAMPLES, len(CHANNELS)))
    measured[:count] = run.measured[start:end]
    mask = (np.arange(SAMPLES) < count).astype(np.float64)
    commands = np.zeros((HISTORY + SAMPLES, 3))
    commands[: HISTORY + count] = run.commands[start - HISTORY : end]
    _left, _right, _gx, q, w, *_ = run.measured[start]
    pitch = float(run.pitch[start])
    v = radius * (float(run.speeds[start].mean()) + q)
    begin = np.array([v, q, w, pitch if math.isfinite(pitch) else 0.0, *run.measured[start, :2]])
    return commands, measured, mask, begin
