"""Where logs go: room and speed. A full or slow disk loses logs; it never holds up the loop."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, good, warning
from segway_ecc.deploy.doctor.system import System, Workload

_MB: Final = 1_000_000
_SLOW: Final = 2.0
"""MB/s: several times what a robot with raw traffic at 1 kHz writes."""
_SLOW_WAIT_S: Final = 1.0


def check_disk(machine: System, workload: Workload) -> Iterator[Finding]:
    """The folder of the logs, or the nearest above it that is there."""
    folder = next(path for path in (workload.logs, *workload.logs.parents) if path.is_dir())
    yield _room(folder, workload)
    yield _speed(machine, folder, workload)


def _room(folder: Path, workload: Workload) -> Finding:
    free = shutil.disk_usage(folder).free
    found = f"{free / _MB:.0f} MB free for {workload.logs}"
    if free >= workload.log_bytes:
        return good("disk room", found)
    return warning(
        "disk room",
        found,
        f"logs may take {workload.log_bytes / _MB:.0f} MB: runs will be recorded in part or not at all",
        f"make room in {folder}, or let logs take less: segway-ecc run --log-limit {max(free // 2 // _MB, 1)}",
    )


def _speed(machine: System, folder: Path, workload: Workload) -> Finding:
    effect = "runs are not recorded; control is not disturbed"
    try:
        speed = machine.probes.write(folder)
    except OSError as error:
        remedy = (
            f"sudo install -d -o $USER {workload.logs}; or as the robot's user: sudo -u segway segway-ecc deploy doctor"
        )
        return warning("disk speed", f"{folder} cannot be written: {error.strerror or error}", effect, remedy)
    found = f"{speed.bytes_per_s / _MB:.1f} MB/s, slowest wait {speed.slowest_s * 1e3:.0f} ms, in {folder}"
    if speed.bytes_per_s < _SLOW * _MB or speed.slowest_s > _SLOW_WAIT_S:
        effect = "the recorder may lose cycles, which the log counts; control is not disturbed"
        remedy = "a faster card or disk, or logs elsewhere: segway-ecc run --log FILE"
        return warning("disk speed", found, effect, remedy)
    return good("disk speed", found)
