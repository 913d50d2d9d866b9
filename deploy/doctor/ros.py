# SPDX-License-Identifier: MIT
"""ROS 2, and the settings by which robot and base station find each other."""

import sys
from collections.abc import Iterator, Mapping
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad, good, warning
from segway_ecc.deploy.support.commands import NoAnswerError

SERVICE_ENVIRONMENT: Final = "/etc/segway-ecc/environment"
_TRY: Final = "import rclpy; print(rclpy.get_rmw_implementation_identifier())"
_NOT_THERE: Final = "No module named"
_TOO_LONG: Final = "gave no answer within"
_INSTALL: Final = "source an installation (. /opt/ros/jazzy/setup.sh), or on x86_64: pip install 'segway-ecc[ros]'"
_DOMAINS: Final = range(233)
_CLEAR_DOMAINS: Final = (range(102), range(215, 233))
"""Those whose ports Linux does not hand out to other programs (ROS 2, 'About ROS domain IDs')."""
_REACH: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_RANGES: Final = {"SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"}
_ALONE: Final = "a base station on another machine does not find this robot"
_PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"


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
        words = machine.answer(["env", *(f"{k}={v}" for k, v in own.items()), sys.executable, "-P", "-c", _TRY]).split()
    except NoAnswerError as error:
        reason = str(error)
        if _TOO_LONG in reason:
            found = f"rclpy did not load within {reason.rpartition('within ')[2]}"
            effect = "the node takes as long to start, and its unit gives up where that is longer than it allows"
            return warning("ROS 2", found, effect, f"see what else runs (top), then: {sys.executable} -P -c '{_TRY}'")
        found = f"rclpy does not load: {reason.removeprefix('env: ')}"
        if _NOT_THERE in reason:
            effect = "the robot runs alone: nobody can watch, command or stop it over the network"
            return warning("ROS 2", found, effect, _INSTALL)
        effect = "the node does not start, unless it is run with --no-ros"
        return bad("ROS 2", found, effect, f"fix what it names, such as RMW_IMPLEMENTATION; or anew: {_INSTALL}")
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
