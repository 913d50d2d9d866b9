# SPDX-License-Identifier: MIT
"""The services that systemd starts, and what their units allow them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import NoAnswerError, System, Workload

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
