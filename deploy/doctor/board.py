# SPDX-License-Identifier: MIT
"""The computer itself: memory, temperature, power, and the disk of the logs.

A full or slow disk loses logs; it never delays the loop.
"""

import shutil
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, graded, warning
from segway_ecc.deploy.doctor.system import System, Workload

_THROTTLED: Final = "/sys/devices/platform/soc/soc:firmware/get_throttled"
_CONDITIONS: Final = {0: "under-voltage", 1: "clock rate capped", 2: "throttled", 3: "soft temperature limit"}
"""Of the Raspberry Pi's firmware; 16 bits higher the same since it was switched on."""
_SINCE_START: Final = 16
_HOT_MILLI_C: Final = 80_000
_LITTLE_MIB: Final = 256
_TOO_LITTLE_MIB: Final = 64
_MB: Final = 1_000_000
_SLOW: Final = 2.0
"""MB/s: several times what a robot with raw traffic at 1 kHz writes."""
_SLOW_WAIT_S: Final = 1.0


def check_board(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Memory everywhere; temperature and power where the machine measures them."""
    lines = (machine.read("/proc/meminfo") or "").splitlines()
    sizes = {name: int(rest.split()[0]) // 1024 for name, _, rest in (line.partition(":") for line in lines) if rest}
    free = sizes.get("MemAvailable")
    found = "not reported by the kernel" if free is None else f"{free} of {sizes.get('MemTotal', 0)} MiB are free"
    remedy = "end what takes it: ps aux --sort=-rss | head; or a computer with more"
    if free is not None and free < _TOO_LITTLE_MIB:
        yield bad("memory", found, "the kernel ends programs, the robot's among them", remedy)
    else:
        fits = free is None or free >= _LITTLE_MIB
        yield graded("memory", found, "ROS and the recorder take about 200 MiB", remedy, fits=fits)
    texts = machine.read_all("/sys/class/thermal/thermal_zone*/temp").values()
    if milli_c := [int(text) for text in texts if text.lstrip("-").isdecimal()]:
        yield graded(
            "temperature",
            f"{max(milli_c) / 1e3:.0f} degrees Celsius",
            "the processor is soon made slower to cool it",
            "a heat sink, a fan, or less to do",
            fits=max(milli_c) < _HOT_MILLI_C,
        )
    throttled = machine.read(_THROTTLED)
    if throttled is None:
        return
    name, bits = "Raspberry Pi power", int(throttled, 16)
    now, before = (
        ", ".join(text for bit, text in _CONDITIONS.items() if found >> bit & 1)
        for found in (bits, bits >> _SINCE_START)
    )
    remedy = "a supply of the board's rated current with a short cable, and a heat sink; vcgencmd get_throttled"
    if now:
        yield bad(name, f"now: {now}", "the processor is slowed down, or the board about to fail", remedy)
    elif before:
        yield warning(name, f"since it was switched on: {before}", "it will come again under load", remedy)
    else:
        yield good(name, "no under-voltage and no throttling since it was switched on")


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
