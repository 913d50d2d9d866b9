"""Whether the loop may keep the processors out of deep idle states, by the kernel's own file for that."""

import os
from collections.abc import Iterator, Mapping
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, good, warning
from segway_ecc.deploy.doctor.services import NODE, properties
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.node.cycle.real_time import IDLE_LATENCY

_NAME: Final = "processor idle states"
_FILE: Final = str(IDLE_LATENCY)
_UNIT: Final = ("User", "SupplementaryGroups", "DevicePolicy", "DeviceAllow")
_OPEN_POLICIES: Final = {"", "auto"}
_EFFECT: Final = "after each wait the processor wakes up slowly and with cold caches: cycles take longer"
RULE: Final = 'SUBSYSTEM=="misc", KERNEL=="cpu_dma_latency", GROUP="segway", MODE="0660"'
"""As deploy/udev/70-segway-latency.rules has it."""
_ALLOW: Final = (
    f"echo '{RULE}' | sudo tee /etc/udev/rules.d/70-segway-latency.rules; "
    f"sudo udevadm control --reload; sudo udevadm trigger {_FILE}"
)
_GROUP_WRITES: Final = 0o020
_ALL_WRITE: Final = 0o002


def check_idle(machine: System, _workload: Workload) -> Iterator[Finding]:
    """The unit's user where there is a unit, since the service is another user than this one."""
    unit = properties(machine, NODE, _UNIT)
    if not machine.path(_FILE).exists():
        yield good(_NAME, f"this kernel has no {_FILE}")
    elif unit:
        yield _of_unit(machine, unit)
    elif os.access(machine.path(_FILE), os.W_OK):
        yield good(_NAME, f"this user may write {_FILE}")
    else:
        remedy = f"{_ALLOW}; sudo usermod -aG segway $USER, then log in again"
        yield warning(_NAME, f"{_FILE} is not writable for this user", _EFFECT, remedy)


def _of_unit(machine: System, unit: Mapping[str, str]) -> Finding:
    if not _may_write(machine, unit):
        return warning(_NAME, f"{_FILE} is not writable for the user of {NODE}", _EFFECT, _ALLOW)
    if unit.get("DevicePolicy", "") not in _OPEN_POLICIES and _FILE not in unit.get("DeviceAllow", "").split():
        remedy = f"DeviceAllow={_FILE} w by: sudo systemctl edit {NODE}"
        return warning(_NAME, f"the unit of {NODE} does not let it have {_FILE}", _EFFECT, remedy)
    return good(_NAME, f"{NODE} may write {_FILE}")


def _may_write(machine: System, unit: Mapping[str, str]) -> bool:
    """By the file's mode, for the unit's user and groups."""
    user = unit.get("User", "")
    if user in {"", "root"}:
        return True
    state = machine.path(_FILE).stat()
    if state.st_mode & _ALL_WRITE:
        return True
    return bool(state.st_mode & _GROUP_WRITES) and state.st_gid in _groups(machine, user, unit)


def _groups(machine: System, user: str, unit: Mapping[str, str]) -> set[int]:
    """The numbers of a user's groups (passwd(5), group(5)), and of those that the unit adds."""
    added = unit.get("SupplementaryGroups", "").split()
    own = {fields[3] for fields in _entries(machine, "/etc/passwd", 7) if fields[0] == user}
    more = {
        fields[2] for fields in _entries(machine, "/etc/group", 4) if fields[0] in added or user in fields[3].split(",")
    }
    return {int(number) for number in own | more if number.isdecimal()}


def _entries(machine: System, path: str, fields: int) -> list[list[str]]:
    lines = (machine.read(path) or "").splitlines()
    return [found for line in lines if len(found := line.split(":")) == fields]
