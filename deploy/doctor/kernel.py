# SPDX-License-Identifier: MIT
"""What the loop runs on: the kernel, for real time and CAN, and Python."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, graded, warning
from segway_ecc.deploy.doctor.system import System, Workload

_DEBIAN_NAMES: Final = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "armmp"}


def check_kernel(machine: System, workload: Workload) -> Iterator[Finding]:
    """Whether the kernel can be interrupted everywhere, and has CAN."""
    release = machine.read("/proc/sys/kernel/osrelease") or "unknown release"
    build = machine.read("/proc/sys/kernel/version") or ""
    is_real_time = machine.read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in build
    package = f"linux-image-rt-{_DEBIAN_NAMES.get(machine.processor, machine.processor)}"
    yield graded(
        "kernel",
        f"{release}, {'' if is_real_time else 'not '}PREEMPT_RT",
        "under load the kernel itself can delay a cycle by milliseconds",
        f"sudo apt-get install {package} (Debian; elsewhere the distribution's real-time kernel), then start it",
        fits=is_real_time,
    )
    name = "CAN in the kernel"
    try:
        machine.probes.can_socket()
    except OSError as error:
        found = f"socket(AF_CAN): {error.strerror}"
        remedy = "sudo modprobe can-raw; where there is no such module, a kernel with CONFIG_CAN and CONFIG_CAN_RAW"
        effect = "no CAN interface can be used, so the drives are out of reach"
        if workload.needs_socketcan:
            yield bad(name, found, effect, remedy)
        elif workload.robot is None:
            yield warning(name, found, effect, remedy)
        else:
            yield good(name, f"{found}; this robot needs none")
    else:
        yield good(name, "socket(AF_CAN) works")


def check_python(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Version, and whether it was built for debugging."""
    yield graded(
        "Python",
        f"{machine.python}, a debug build" if machine.is_debug_python else machine.python,
        "each cycle takes several times as long",
        "make the virtual environment with the distribution's python3: python3 -m venv FOLDER",
        fits=not machine.is_debug_python,
    )
