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
        yield _for_unit(machine, unit)
    elif os.access(machine.path(_FILE), os.W_OK):
        yield good(_NAME, f"this user may write {_FILE}")
    else:
        remedy = f"{_ALLOW}; sudo usermod -aG segway $USER, then log in again"
        yield warning(_NAME, f"{_FILE} is not writable for this user", _EFFECT, remedy)


def _for_unit(machine: System, unit: Mapping[str, str]) -> Finding:
    user, state = unit.get("User", ""), machine.path(_FILE).stat()
    is_group_s = bool(state.st_mode & _GROUP_WRITES) and state.st_gid in _groups(machine, user, unit)
    if user not in {"", "root"} and not state.st_mode & _ALL_WRITE and not is_group_s:
        return warning(_NAME, f"{_FILE} is not writable for the user of {NODE}", _EFFECT, _ALLOW)
    if unit.get("DevicePolicy", "") not in _OPEN_POLICIES and _FILE not in unit.get("DeviceAllow", "").split():
        remedy = f"DeviceAllow={_FILE} w by: sudo systemctl edit {NODE}"
        return warning(_NAME, f"the unit of {NODE} does not allow it {_FILE}", _EFFECT, remedy)
    return good(_NAME, f"{NODE} may write {_FILE}")


def _groups(machine: System, user: str, unit: Mapping[str, str]) -> set[int]:
    """The numbers of a user's groups (passwd(5), group(5)), and of those that the unit adds."""
    users, groups = (
        [fields for line in (machine.read(path) or "").splitlines() if len(fields := line.split(":")) == count]
        for path, count in (("/etc/passwd", 7), ("/etc/group", 4))
    )
    added = unit.get("SupplementaryGroups", "").split()
    own = {fields[3] for fields in users if fields[0] == user}
    more = {fields[2] for fields in groups if fields[0] in added or user in fields[3].split(",")}
    return {int(number) for number in own | more if number.isdecimal()}
