"""Where logs go: space and speed. A full or slow disk loses logs; it never delays the loop."""

import shutil
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, graded, warning
from segway_ecc.deploy.doctor.system import System, Workload

_MB: Final = 1_000_000
_SLOW: Final = 2.0
"""MB/s: several times what a robot with raw traffic at 1 kHz writes."""
_SLOW_WAIT_S: Final = 1.0


def check_disk(machine: System, workload: Workload) -> Iterator[Finding]:
    """The folder of the logs, or the nearest above it that is there."""
    logs = workload.logs
    folder = next(path for path in (logs, *logs.parents) if path.is_dir())
    free = shutil.disk_usage(folder).free
    yield graded(
        "disk space",
        f"{free / _MB:.0f} MB free for {logs}",
        f"logs may take {workload.log_bytes / _MB:.0f} MB: runs will be recorded in part or not at all",
        f"free some in {folder}, or let logs take less: segway-ecc run --log-limit {max(free // 2 // _MB, 1)}",
        fits=free >= workload.log_bytes,
    )
    try:
        speed = machine.probes.write(folder)
    except OSError as error:
        yield warning(
            "disk speed",
            f"{folder} cannot be written: {error.strerror or error}",
            "runs are not recorded; control is not disturbed",
            f"sudo install -d -o $USER {logs}; or as the robot's user: sudo -u segway segway-ecc deploy doctor",
        )
        return
    yield graded(
        "disk speed",
        f"{speed.bytes_per_s / _MB:.1f} MB/s, slowest wait {speed.slowest_s * 1e3:.0f} ms, in {folder}",
        "the recorder may lose cycles, which the log counts; control is not disturbed",
        "a faster card or disk, or logs elsewhere: segway-ecc run --log FILE",
        fits=speed.bytes_per_s >= _SLOW * _MB and speed.slowest_s <= _SLOW_WAIT_S,
    )
