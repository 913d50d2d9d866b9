# SPDX-License-Identifier: MIT
"""The services that systemd starts, what the kernel and their units allow them, and the ROS 2 that they load."""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad, good, graded, warning
from segway_ecc.deploy.support.commands import NoAnswerError
from segway_ecc.node.cycle.real_time import IDLE_LATENCY, PRIORITY
from segway_ecc.node.ros.runtime import ENFORCE, STRATEGY, why_not_secure

SERVICE_ENVIRONMENT: Final = "/etc/segway-ecc/environment"
_LOAD: Final = """\
from segway_ecc.node.ros.runtime import ros_node
with ros_node("segway_ecc_doctor", ""):
    import rclpy
    print(rclpy.get_rmw_implementation_identifier())
"""
"""As the node of a robot starts: under what it does not start under, neither does this."""
_NOT_THERE: Final = ("No module named", "is not available here")
_OURS: Final = "segway_ecc.node.errors.RosUnavailableError: "
_TRY_ROS: Final = "segway-ecc run cart --ros --no-log --duration 1"
_TOO_LONG: Final = "gave no answer within"
_INSTALL: Final = "source an installation (. /opt/ros/jazzy/setup.sh), or on x86_64: pip install 'segway-ecc[ros]'"
_DOMAINS: Final = range(233)
_CLEAR_DOMAINS: Final = (range(102), range(215, 233))
"""Those whose ports Linux does not hand out to other programs (ROS 2, 'About ROS domain IDs')."""
_REACH: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_RANGES: Final = {"SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"}
_ALONE: Final = "a base station on another machine does not find this robot"
_PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
NODE: Final = "segway-ecc-node.service"
_UNITS: Final = {
    NODE: "the robot does not start at boot, and is not started again when it dies",
    "segway-ecc-guard.service": "when the node dies, the drives' own watchdogs alone switch the motors off",
}
_STATION: Final = "segway-ecc-station.service"
_STATION_S: Final = "/etc/segway-ecc/station.environment"
"""Written by `segway-ecc station install`; without it a machine is none."""
_OPTIONAL: Final = ("segway-ecc-archive.service", _STATION, "segway-ecc.target")
_ASKED: Final = ("UnitFileState", "ActiveState", "SubState", "NRestarts")
_INSTALLED: Final = ("loaded", "masked")
"""A unit that is masked has no settings of its own any more."""
_AT_BOOT: Final = {"enabled", "enabled-runtime", "static", "alias", "indirect", "generated", "linked"}
_TRY: Final = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))"
_CAP_IPC_LOCK: Final = 1 << 14
"""Of linux/capability.h."""
_MIB: Final = 1024 * 1024
_FIFO: Final = {"1", "fifo"}
_UNIT: Final = ("CPUSchedulingPolicy", "LimitMEMLOCK", "AmbientCapabilities", "User")
_LIMITS_FILE: Final = "/etc/security/limits.d/segway-ecc.conf"
_IDLE: Final = "processor idle states"
_IDLE_FILE: Final = str(IDLE_LATENCY)
_IDLE_UNIT: Final = ("User", "SupplementaryGroups", "DevicePolicy", "DeviceAllow")
_OPEN_POLICIES: Final = {"", "auto"}
_IDLE_EFFECT: Final = "after each wait the processor wakes up slowly and with cold caches: cycles take longer"
RULE: Final = 'SUBSYSTEM=="misc", KERNEL=="cpu_dma_latency", GROUP="segway", MODE="0660"'
"""As deploy/udev/70-segway-latency.rules has it."""
_IDLE_ALLOW: Final = (
    f"echo '{RULE}' | sudo tee /etc/udev/rules.d/70-segway-latency.rules; "
    f"sudo udevadm control --reload; sudo udevadm trigger {_IDLE_FILE}"
)
_GROUP_WRITES: Final = 0o020
_ALL_WRITE: Final = 0o002


def has_systemd(machine: System) -> bool:
    """Whether systemd runs here (sd_booted(3))."""
    return machine.path("/run/systemd/system").is_dir()


def properties(
    machine: System, unit: str, names: Sequence[str], states: Sequence[str] = ("loaded",)
) -> Mapping[str, str]:
    """Properties of a unit; empty where there is no systemd, or the unit is in none of these load states."""
    if not has_systemd(machine):
        return {}
    try:
        text = machine.answer(["systemctl", "show", f"--property={','.join(['LoadState', *names])}", unit])
    except NoAnswerError:
        return {}
    found: dict[str, str] = {}
    for name, _, value in (line.partition("=") for line in text.splitlines()):
        found[name] = f"{found[name]} {value}" if name in found else value  # a list is a line for each
    return found if found.get("LoadState") in states else {}


def check_services(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Whether our units are there, start at boot, and run."""
    if not has_systemd(machine):
        yield warning(
            "services",
            "no systemd runs here",
            "the robot starts only when somebody starts it",
            "start it from the machine's own init: segway-ecc run ROBOT; or boot a system with systemd",
        )
        return
    for unit, effect in _UNITS.items():
        state = properties(machine, unit, _ASKED, _INSTALLED)
        if state:
            yield _unit(unit, state)
        else:
            yield warning(unit, "not installed", effect, "from your machine: segway-ecc deploy push HOST")
    for unit in _OPTIONAL:
        state = properties(machine, unit, _ASKED, _INSTALLED)
        if unit == _STATION and state.get("UnitFileState") == "disabled" and not machine.path(_STATION_S).exists():
            yield good(unit, "off: this machine is no base station")
        elif state:
            yield _unit(unit, state)


def _unit(unit: str, state: Mapping[str, str]) -> Finding:
    at_boot, active = state.get("UnitFileState", ""), state.get("ActiveState", "")
    found = f"{at_boot or 'no unit file state'}, {active} ({state.get('SubState', '')})"
    look = f"journalctl --boot --unit {unit}"
    if active == "failed":
        effect = "it does not run, and nobody starts it again"
        return bad(unit, found, effect, f"{look}; then: sudo systemctl restart {unit}")
    if active == "activating" and state.get("NRestarts", "0") != "0":
        return bad(unit, f"{found}, restarted {state['NRestarts']} times", "it dies as it starts", look)
    if at_boot not in _AT_BOOT:
        unmask = f"sudo systemctl unmask {unit}; " if at_boot.startswith("masked") else ""
        return warning(unit, found, "it does not start at boot", f"{unmask}sudo systemctl enable --now {unit}")
    if active != "active":
        return warning(unit, found, "it does not run now", f"sudo systemctl start {unit}")
    return good(unit, found)


def check_privileges(machine: System, workload: Workload) -> Iterator[Finding]:
    """Real-time scheduling, locked memory, and what the kernel takes of real-time programs."""
    unit = properties(machine, NODE, _UNIT)
    yield _scheduling(machine, workload, unit)
    yield _memory_lock(machine, unit)
    name = "real-time throttling"
    runtime = machine.read("/proc/sys/kernel/sched_rt_runtime_us")
    period = machine.read("/proc/sys/kernel/sched_rt_period_us")
    remedy = "sudo sysctl kernel.sched_rt_runtime_us=950000"
    if runtime is None or period is None:
        yield good(name, "this kernel has none")
    elif int(runtime) == 0:
        yield bad(name, "0 us for real-time programs", "real-time programs never run", remedy)
    elif int(runtime) < 0:
        effect = "a real-time program that hangs holds its processor for ever, and nobody can log in to end it"
        yield warning(name, "off", effect, remedy)
    else:
        yield good(name, f"real-time programs get {int(runtime) / int(period):.0%} of each {int(period) / 1e6:g} s")


def _scheduling(machine: System, workload: Workload, unit: Mapping[str, str]) -> Finding:
    """By the unit where there is one, since the service is another user than this one."""
    name, grade = "real-time scheduling", warning if workload.hardware is None else bad
    effect = "any other program can delay the loop"
    if unit:
        if unit.get("CPUSchedulingPolicy") in _FIFO or _may(unit, "cap_sys_nice"):
            return good(name, f"SCHED_FIFO for {NODE}, by its unit")
        remedy = f"CPUSchedulingPolicy=fifo and CPUSchedulingPriority={PRIORITY} by: sudo systemctl edit {NODE}"
        return grade(name, f"the unit of {NODE} does not ask for SCHED_FIFO", effect, remedy)
    try:
        # In a child, so that this process stays as it is.
        machine.answer([sys.executable, "-I", "-S", "-c", _TRY])
    except NoAnswerError as error:
        found = f"SCHED_FIFO {PRIORITY} refused to this user: {str(error).rpartition('] ')[2]}"
        return grade(name, found, effect, _allow(f"rtprio {PRIORITY}"))
    return good(name, f"SCHED_FIFO {PRIORITY} granted to this user")


def _may(unit: Mapping[str, str], capability: str) -> bool:
    """Whether a unit's processes have a capability: named, or root's."""
    return unit.get("User") in {"", "root"} or capability in unit.get("AmbientCapabilities", "").lower()


def _memory_lock(machine: System, unit: Mapping[str, str]) -> Finding:
    if unit:
        limit, who = unit.get("LimitMEMLOCK", ""), f"{NODE}, by its unit"
        fits = limit == "infinity" or _may(unit, "cap_ipc_lock")
        remedy = f"LimitMEMLOCK=infinity by: sudo systemctl edit {NODE}"
    else:
        limit, who = _first_word(machine, "/proc/self/limits", "Max locked memory"), "this user"
        capabilities = int(_first_word(machine, "/proc/self/status", "CapEff:") or "0", 16)
        fits = limit == "unlimited" or bool(capabilities & _CAP_IPC_LOCK)
        remedy = _allow("memlock unlimited")
    amount = f"{int(limit) / _MIB:.1f} MiB at most" if limit.isdecimal() else "the limit is not known"
    found = f"any amount for {who}" if fits else amount
    return graded("memory lock", found, "where memory runs short, the loop waits for the disk", remedy, fits=fits)


def _allow(what: str) -> str:
    """The command that lets a user do something from the next log-in on (limits.conf(5))."""
    return f'echo "$USER - {what}" | sudo tee --append {_LIMITS_FILE}, then log in again; or run the robot as {NODE}'


def _first_word(machine: System, path: str, start: str) -> str:
    """The first word after `start` of the line that begins so; empty where there is none."""
    lines = (machine.read(path) or "").splitlines()
    return next((line.removeprefix(start).split()[0] for line in lines if line.startswith(start)), "")


def check_idle(machine: System, _workload: Workload) -> Iterator[Finding]:
    """The unit's user where there is a unit, since the service is another user than this one."""
    unit = properties(machine, NODE, _IDLE_UNIT)
    if not machine.path(_IDLE_FILE).exists():
        yield good(_IDLE, f"this kernel has no {_IDLE_FILE}")
    elif unit:
        yield _for_unit(machine, unit)
    elif os.access(machine.path(_IDLE_FILE), os.W_OK):
        yield good(_IDLE, f"this user may write {_IDLE_FILE}")
    else:
        remedy = f"{_IDLE_ALLOW}; sudo usermod -aG segway $USER, then log in again"
        yield warning(_IDLE, f"{_IDLE_FILE} is not writable for this user", _IDLE_EFFECT, remedy)


def _for_unit(machine: System, unit: Mapping[str, str]) -> Finding:
    user, state = unit.get("User", ""), machine.path(_IDLE_FILE).stat()
    # The groups of the unit's user (passwd(5), group(5)), and those that the unit adds.
    users, groups = (
        [fields for line in (machine.read(path) or "").splitlines() if len(fields := line.split(":")) == count]
        for path, count in (("/etc/passwd", 7), ("/etc/group", 4))
    )
    added = unit.get("SupplementaryGroups", "").split()
    numbers = {fields[3] for fields in users if fields[0] == user}
    numbers |= {fields[2] for fields in groups if fields[0] in added or user in fields[3].split(",")}
    is_group_s = bool(state.st_mode & _GROUP_WRITES) and str(state.st_gid) in numbers
    if user not in {"", "root"} and not state.st_mode & _ALL_WRITE and not is_group_s:
        return warning(_IDLE, f"{_IDLE_FILE} is not writable for the user of {NODE}", _IDLE_EFFECT, _IDLE_ALLOW)
    if unit.get("DevicePolicy", "") not in _OPEN_POLICIES and _IDLE_FILE not in unit.get("DeviceAllow", "").split():
        remedy = f"DeviceAllow={_IDLE_FILE} w by: sudo systemctl edit {NODE}"
        return warning(_IDLE, f"the unit of {NODE} does not allow it {_IDLE_FILE}", _IDLE_EFFECT, remedy)
    return good(_IDLE, f"{NODE} may write {_IDLE_FILE}")


def check_ros(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Whether ROS loads, and whom it finds; by the service's own settings where it has a file of them."""
    place, settings, text = "the environment", machine.environment, machine.read(SERVICE_ENVIRONMENT)
    if text is not None:
        lines = (line.strip() for line in text.splitlines())
        pairs = (line.partition("=") for line in lines if "=" in line and not line.startswith(("#", ";")))
        place = SERVICE_ENVIRONMENT
        settings = {name.strip(): value.strip().strip("\"'") for name, _, value in pairs}
    yield _loads(machine, {} if text is None else settings)
    yield _domain(settings.get("ROS_DOMAIN_ID", ""), place)
    yield _discovery(settings, place)
    open_end = why_not_secure(settings)
    if open_end is not None:
        effect = (
            "anybody in its network may command a robot that was meant to be secured, and secured nodes do not see it"
        )
        yield warning("ROS security", open_end, effect, f"{STRATEGY}={ENFORCE} in {place}")
    if _PROFILES in settings:
        name, path = "Fast DDS profiles", settings[_PROFILES]
        effect = "Fast DDS goes on with its own settings, so discovery and transports are not as meant"
        remedy = f"correct {_PROFILES} in {place}, or the file it names"
        try:
            ET.fromstring(machine.path(path).read_bytes())  # noqa: S314 - of this machine; Fast DDS would read it next
        except OSError as error:
            yield warning(name, f"{path}: {error.strerror}", effect, remedy)
        except ET.ParseError as error:
            yield warning(name, f"{path} is not XML: {error}", effect, remedy)
        else:
            yield good(name, path)


def _loads(machine: System, own: Mapping[str, str]) -> Finding:
    """Loaded in a child as the service would: only that shows that all libraries are there and fit."""
    try:
        named = (f"{name}={value}" for name, value in own.items())
        words = machine.answer(["env", *named, sys.executable, "-P", "-c", _LOAD]).split()
    except NoAnswerError as error:
        reason = str(error)
        if _TOO_LONG in reason:
            found = f"rclpy did not load within {reason.rpartition('within ')[2]}"
            effect = "the node takes as long to start, and its unit gives up where that is longer than it allows"
            return warning("ROS 2", found, effect, f"see what else runs (top), then: {_TRY_ROS}")
        reason = reason.removeprefix("env: ").removeprefix(_OURS)
        found = f"rclpy does not load: {reason}"
        if any(text in reason for text in _NOT_THERE):
            effect = "the robot runs alone: nobody can watch, command or stop it over the network"
            return warning("ROS 2", found, effect, _INSTALL)
        effect = "the node does not start, unless it is run with --no-ros"
        remedy = f"fix what it names, such as RMW_IMPLEMENTATION, and try: {_TRY_ROS}; or anew: {_INSTALL}"
        return bad("ROS 2", found, effect, remedy)
    return good("ROS 2", f"rclpy loads, with {words[-1] if words else 'an unnamed middleware'}")


def _domain(text: str, place: str) -> Finding:
    name = "ROS domain"
    if not text:
        return good(name, "0")
    found, remedy = f"ROS_DOMAIN_ID={text} in {place}", f"ROS_DOMAIN_ID=0 to 101, in {place}"
    if not text.isdecimal() or int(text) not in _DOMAINS:
        return bad(name, found, "ROS 2 does not start, and the node neither", remedy)
    if not any(int(text) in clear for clear in _CLEAR_DOMAINS):
        effect = "other programs may have its ports, and then robot and base station do not find each other"
        return warning(name, found, effect, remedy)
    return good(name, f"{text}, of {place}")


def _discovery(settings: Mapping[str, str], place: str) -> Finding:
    name, reach = "ROS discovery", settings.get(_REACH) or "SUBNET"
    server, peers = settings.get("ROS_DISCOVERY_SERVER"), settings.get("ROS_STATIC_PEERS")
    setting, effect = f"{_REACH}={reach}", ""
    if settings.get("ROS_LOCALHOST_ONLY") == "1":
        setting, effect = "ROS_LOCALHOST_ONLY=1", _ALONE
    elif reach not in _RANGES:
        effect = "ROS 2 does not know this value, and does not go beyond this machine"
    elif reach == "OFF":
        effect = "nobody finds this robot, static peers neither"
    elif reach == "LOCALHOST" and not (server or peers):
        effect = _ALONE
    if effect:
        remedy = f"in {place}: ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET (and no ROS_LOCALHOST_ONLY), or ROS_STATIC_PEERS"
        return warning(name, f"{setting} in {place}", effect, remedy)
    if server:
        return good(name, f"by the discovery server {server}, of {place}")
    where = "this machine" if reach == "LOCALHOST" else "the whole subnet"
    return good(name, f"{where}, and static peers {peers}, of {place}" if peers else where)
