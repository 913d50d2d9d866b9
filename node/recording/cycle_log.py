# SPDX-License-Identifier: MIT
"""Cycles as messages: what each topic of a run's log holds."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.signals import IMU_SIGNALS, ODOMETRY_SIGNALS, effort_signals, joint_signals
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.recording.cdr import CYCLE_EVENTS, CYCLE_EVENTS_SCHEMA, STATE, STATE_SCHEMA
from segway_ecc.node.recording.codec import CycleCodec, state_message
from segway_ecc.node.recording.cycle_message import CYCLE_TOPIC, CYCLE_TYPE, cycle_of, stamp_of
from segway_ecc.node.recording.layout import (
    END_FILE,
    NO_PROVENANCE,
    PART_FILE,
    CycleLayout,
    LogEnd,
    LogPart,
    Provenance,
    surroundings,
)
from segway_ecc.node.recording.mcap_log import McapLog

EVENTS_TOPIC = "/cycle_events"
STATE_TOPIC = "/state"
LAYOUT_FILE = "layout.json"
"""The attachment that holds the exact names behind the fields of `/cycle`."""
COPIES: Final = 2
"""Of each attachment: without it no cycle means anything."""


class CycleLog(McapLog):
    """An MCAP log of cycles, written where it is called.

    `/cycle` holds everything of a cycle that is a number, `/cycle_events` what else happened in it: from these two a
    run is replayed. `/state` is what the replay is compared with on the way, and goes on from behind a gap. What the
    robot publishes in ROS is on the same topics here, so that any tool for ROS shows it:
    `/odom`, `/joint_states`, `/imu/data`, `/setpoint`, `/diagnostics`.
    """

    def __init__(
        self,
        path: Path,
        layout: CycleLayout,
        provenance: Provenance = NO_PROVENANCE,
        part: LogPart | None = None,
    ) -> None:
        """Create the log; it stands alone, with its provenance. It is the first file of a run, or that `part` of one.

        Raises:
            RecordingError: The file cannot be written.
        """
        super().__init__(
            path, frame_id=layout.odometry_frame, child_frame_id=layout.base_frame, joint_names=layout.joints
        )
        self._codec = CycleCodec(layout)
        self.metadata("robot", {"name": layout.robot})
        around = surroundings() if provenance.metadata else {}
        for name, values in (provenance.metadata | around).items():
            self.metadata(name, values)
        layout_text = msgspec.json.format(msgspec.json.encode(layout)).decode()
        self._part = part or LogPart()
        self._last_cycle: int | None = None
        part_text = msgspec.json.encode(self._part).decode()
        for name, text in {PART_FILE: part_text, LAYOUT_FILE: layout_text, **provenance.attachments}.items():
            self.attach(name, "text/plain", text.encode(), COPIES)
        published = {signal: index for index, signal in enumerate(layout.published)}
        self._odometry = _indices(published, ODOMETRY_SIGNALS)
        self._joints = _indices(published, joint_signals(layout.published))
        self._efforts = _indices(published, effort_signals(layout.published)) or ()
        self._imu = _indices(published, IMU_SIGNALS)
        self._imu_frame = layout.imu_frame

    def write(self, record: CycleRecord) -> None:
        """Log one cycle."""
        events, cycle = self._codec.messages(record)
        if events is not None:
            self.write_events(events)
        self.write_cycle(cycle)

    def write_cycle(self, message: bytes) -> None:
        """Log a cycle that is a message already; what happened in it has been logged before."""
        stamp_ns = stamp_of(message)
        self.add(CYCLE_TOPIC, CYCLE_TYPE, stamp_ns, message, self._codec.message.schema)
        self._last_cycle = cycle_of(message)
        self.twist("/setpoint", stamp_ns, *self._codec.message.setpoint(message))
        published = self._codec.message.published(message)
        if self._odometry is not None:
            self.odometry("/odom", stamp_ns, *(published[index] for index in self._odometry))
        if self._joints is not None:
            measured, count = [published[index] for index in self._joints], len(self._joints) // 2
            if all(map(math.isfinite, measured)):
                efforts = [published[index] for index in self._efforts]
                if not all(map(math.isfinite, efforts)):
                    efforts = []
                self.joint_state("/joint_states", stamp_ns, measured[:count], measured[count:], efforts)
        if self._imu is not None:
            wx, wy, wz, ax, ay, az = measured = [published[index] for index in self._imu]
            if all(map(math.isfinite, measured)):
                self.imu("/imu/data", stamp_ns, self._imu_frame, (wx, wy, wz), (ax, ay, az))

    def write_events(self, message: bytes) -> None:
        """Log what happened in a cycle."""
        self.add(EVENTS_TOPIC, CYCLE_EVENTS, stamp_of(message), message, CYCLE_EVENTS_SCHEMA)

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        """Log a snapshot of what later cycles depend on."""
        self.write_snapshot(state_message(take()))

    def write_snapshot(self, message: bytes) -> None:
        """Log a snapshot that is a message already."""
        self.add(STATE_TOPIC, STATE, stamp_of(message), message, STATE_SCHEMA)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Log a set of diagnostics."""
        self.diagnostics("/diagnostics", stamp_ns, statuses)

    def close(self, *, is_end: bool = True, last_cycle: int | None = None) -> None:
        """Finish the file; it is the run's last where `is_end`, and has the run's last cycle unless that is given."""
        if is_end and self.is_open:
            last = self._last_cycle if last_cycle is None else last_cycle
            end = LogEnd(self._part.run, self._part.number, last)
            self.attach(END_FILE, "text/plain", msgspec.json.encode(end), COPIES)
        super().close()


def _indices(published: dict[str, int], wanted: Sequence[str]) -> list[int] | None:
    return [published[signal] for signal in wanted] if all(signal in published for signal in wanted) else None
