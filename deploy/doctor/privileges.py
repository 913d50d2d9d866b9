"""What the kernel lets us do: real-time scheduling and locked memory."""

import sys
from collections.abc import Iterator, Mapping
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.services import NODE, properties
from segway_ecc.deploy.doctor.system import NoAnswerError, System, Workload
from segway_ecc.node.cycle.real_time import PRIORITY

_TRY: Final = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))"
_CAP_IPC_LOCK: Final = 1 << 14
"""Of linux/capability.h."""
_MIB: Final = 1024 * 1024
_FIFO: Final = {"1", "fifo"}
_UNIT: Final = ("CPUSchedulingPolicy", "LimitMEMLOCK", "AmbientCapabilities", "User")
_LIMITS_FILE: Final = "/etc/security/limits.d/segway-ecc.conf"


def check_privileges(machine: System, workload: Workload) -> Iterator[Finding]:
    """Real-time scheduling, locked memory, and what the kernel takes of real-time programs."""
    unit = properties(machine, NODE, _UNIT)
    yield _scheduling(machine, workload, unit)
    yield _memory_lock(machine, unit)
    yield _throttling(machine)


def _scheduling(machine: System, workload: Workload, unit: Mapping[str, str]) -> Finding:
    """The unit's word where there is one, since the service is another user than this one."""
    name, grade = "real-time scheduling", warning if workload.hardware is None else bad
    effect = "any other program can hold up the loop"
    if unit:
        if unit.get("CPUSchedulingPolicy") in _FIFO or _may(unit, "cap_sys_nice"):
            return good(name, f"SCHED_FIFO for {NODE}, by its unit")
        remedy = f"CPUSchedulingPolicy=fifo and CPUSchedulingPriority={PRIORITY} by: sudo systemctl edit {NODE}"
        return grade(name, f"the unit of {NODE} does not ask for SCHED_FIFO", effect, remedy)
    refusal = _refusal(machine)
    if refusal is None:
        return good(name, f"SCHED_FIFO {PRIORITY} granted to this user")
    remedy = _allow(f"rtprio {PRIORITY}")
    return grade(name, f"SCHED_FIFO {PRIORITY} refused to this user: {refusal}", effect, remedy)


def _refusal(machine: System) -> str | None:
    """Why a child of ours may not have it; None where it may. In a child, so that this process stays as it is."""
    try:
        machine.answer([sys.executable, "-I", "-S", "-c", _TRY])
    except NoAnswerError as error:
        return str(error).rpartition("] ")[2]
    return None


def _may(unit: Mapping[str, str], capability: str) -> bool:
    """Whether a unit's processes have a capability: named, or root's."""
    return unit.get("User") in {"", "root"} or capability in unit.get("AmbientCapabilities", "").lower()


def _memory_lock(machine: System, unit: Mapping[str, str]) -> Finding:
    name, effect = "memory lock", "where memory runs short, the loop waits for the disk"
    if unit:
        limit = unit.get("LimitMEMLOCK", "")
        if limit == "infinity" or _may(unit, "cap_ipc_lock"):
            return good(name, f"any amount for {NODE}, by its unit")
        return warning(name, _amount(limit), effect, f"LimitMEMLOCK=infinity by: sudo systemctl edit {NODE}")
    limit = _locked_limit(machine)
    if limit == "unlimited" or _capabilities(machine) & _CAP_IPC_LOCK:
        return good(name, "any amount for this user")
    return warning(name, _amount(limit), effect, _allow("memlock unlimited"))


def _allow(what: str) -> str:
    """The command that lets a user do something from the next log-in on (limits.conf(5))."""
    return f'echo "$USER - {what}" | sudo tee --append {_LIMITS_FILE}, then log in again; or run the robot as {NODE}'


def _amount(limit: str) -> str:
    return f"{int(limit) / _MIB:.1f} MiB at most" if limit.isdecimal() else "the limit is not known"


def _capabilities(machine: System) -> int:
    for line in (machine.read("/proc/self/status") or "").splitlines():
        if line.startswith("CapEff:"):
            return int(line.split()[1], 16)
    return 0


def _locked_limit(machine: System) -> str:
    """The soft limit in bytes, or `unlimited`; empty where it is not known."""
    for line in (machine.read("/proc/self/limits") or "").splitlines():
        if line.startswith("Max locked memory"):
            return line.split()[3]
    return ""


def _throttling(machine: System) -> Finding:
    name = "real-time throttling"
    runtime = machine.read("/proc/sys/kernel/sched_rt_runtime_us")
    period = machine.read("/proc/sys/kernel/sched_rt_period_us")
    if runtime is None or period is None:
        return good(name, "this kernel has none")
    if int(runtime) == 0:
        effect = "real-time programs never run"
        return bad(name, "0 us for real-time programs", effect, "sudo sysctl kernel.sched_rt_runtime_us=950000")
    if int(runtime) < 0:
        return warning(
            name,
            "off",
            "a real-time program that hangs holds its processor for ever, and nobody can log in to end it",
            "sudo sysctl kernel.sched_rt_runtime_us=950000",
        )
    return good(name, f"real-time programs get {int(runtime) / int(period):.0%} of each {int(period) / 1e6:g} s")
