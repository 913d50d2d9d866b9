"""What a drive is to be set up to."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Plan:
    """How a drive is to be set up.

    Attributes:
        node_id: The drive.
        host_node_id: The node whose heartbeat it is to watch.
        watchdog_ms: How long it waits for that heartbeat.
        cycle_us: The period of SYNC.
        max_torque: Largest torque that will be asked of its motor, N m.
    """

    node_id: int
    host_node_id: int
    watchdog_ms: int
    cycle_us: int
    max_torque: float
