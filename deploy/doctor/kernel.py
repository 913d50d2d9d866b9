"""The kernel: real time, and CAN."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import System, Workload

_DEBIAN_NAMES: Final = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "armmp"}


def check_kernel(machine: System, workload: Workload) -> Iterator[Finding]:
    """Whether the kernel can be interrupted everywhere, and speaks CAN."""
    yield _real_time(machine)
    yield _can(machine, workload)


def _real_time(machine: System) -> Finding:
    release = machine.read("/proc/sys/kernel/osrelease") or "unknown release"
    build = machine.read("/proc/sys/kernel/version") or ""
    if machine.read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in build:
        return good("kernel", f"{release}, PREEMPT_RT")
    package = f"linux-image-rt-{_DEBIAN_NAMES.get(machine.processor, machine.processor)}"
    return warning(
        "kernel",
        f"{release}, not PREEMPT_RT",
        "under load the kernel itself can hold up a cycle by milliseconds",
        f"sudo apt-get install {package} (Debian; elsewhere the distribution's real-time kernel), then start it",
    )


def _can(machine: System, workload: Workload) -> Finding:
    name = "CAN in the kernel"
    try:
        machine.probes.can_socket()
    except OSError as error:
        found = f"socket(AF_CAN): {error.strerror}"
    else:
        return good(name, "socket(AF_CAN) works")
    if workload.robot is not None and not workload.needs_socketcan:
        return good(name, f"{found}; this robot needs none")
    remedy = "sudo modprobe can-raw; where there is no such module, a kernel with CONFIG_CAN and CONFIG_CAN_RAW"
    effect = "no CAN interface can be used, so the drives are out of reach"
    return bad(name, found, effect, remedy) if workload.needs_socketcan else warning(name, found, effect, remedy)
