# SPDX-License-Identifier: MIT
"""ROS 2 itself: starting and leaving it, what its graph connects, and how DDS carries messages.

Messages between processes of one machine do not go through shared memory. Where Fast DDS meets another participant on
its machine, it looks after the health of the shared-memory port between them, and whoever publishes meanwhile waits:
about 330 ms were measured in the publishing of a loop as robots and a station found each other (Fast DDS issue 6535). A
robot that balances cannot wait that long, so our processes use UDP. Others on the machine need no setting: they use
shared memory among themselves and UDP with ours.
"""

import contextlib
import ctypes
import importlib
import importlib.util
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.ros.messages import TF2, TWIST_STAMPED_TYPE, TWIST_TYPE, RosObject

_MODULES: Final = (
    "rclpy.node",
    "geometry_msgs.msg",
    "nav_msgs.msg",
    "sensor_msgs.msg",
    "std_msgs.msg",
    "std_srvs.srv",
    "diagnostic_msgs.msg",
    "trajectory_msgs.msg",
)
_GENERATORS: Final = "rosidl_generator_py.generate_py_impl"
"""Makes Python of message definitions, for which a package that every message needs imports parsers: 6 MB, 50 ms."""
_NEEDED: Final = tuple(name.partition(".")[0] for name in _MODULES)
_ROS_OWN: Final = ("/rosout", "/parameter_events")

UNKNOWN_NODE: Final = "_NODE_NAME_UNKNOWN_"
"""The graph's name of a node of which only a topic was discovered yet."""
PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Names the file of profiles that Fast DDS 2.14 reads when the process makes its first participant."""

TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
RMW: Final = "RMW_IMPLEMENTATION"
DOMAIN: Final = "ROS_DOMAIN_ID"
_LAST_DOMAIN: Final = 232
"""Of a larger one the ports would be no ports (OMG DDSI-RTPS 2.3, 9.6.1)."""
RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS: Final = "ROS_STATIC_PEERS"
LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
SECURITY: Final = "ROS_SECURITY_ENABLE"
STRATEGY: Final = "ROS_SECURITY_STRATEGY"
ENFORCE: Final = "Enforce"

_WAKE_S: Final = 0.1
_OWN_FILE: Final = Path("DEFAULT_FASTRTPS_PROFILES.xml")
"""What Fast DDS reads from the working directory."""

_PARTICIPANTS_ON_A_HOST: Final = 32
"""How many of a peer's ports are asked, as ROS 2 does."""

_PROFILES_TEXT: Final = """\
<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>udp</transport_id>
      <type>UDPv4</type>
      <maxInitialPeersRange>{participants}</maxInitialPeersRange>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="udp" is_default_profile="true">
    <rtps>
      <userTransports><transport_id>udp</transport_id></userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>{discovery}
    </rtps>
  </participant>
</profiles>
"""
_DISCOVERY_TEXT: Final = """
      <builtin>
        <metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList>
        <initialPeersList>{peers}</initialPeersList>
      </builtin>"""
_PEER_TEXT: Final = "<locator><udpv4><address>{address}</address></udpv4></locator>"


def missing_packages() -> list[str]:
    """The ROS packages that cannot be found here; empty where ROS is usable."""
    return [name for name in _NEEDED if importlib.util.find_spec(name) is None]


def require_ros() -> None:
    """Make sure that ROS is there, and starts with the environment as it is.

    Raises:
        RosUnavailableError: With what is wrong and how to correct it.
    """
    require_packages()
    domain, rmw = os.environ.get(DOMAIN, ""), os.environ.get(RMW, "")
    if domain and not (domain.isascii() and domain.isdecimal() and int(domain) <= _LAST_DOMAIN):
        raise RosUnavailableError(f"{DOMAIN} is '{domain}': it must be a whole number from 0 to {_LAST_DOMAIN}")
    if rmw and not _is_installed(rmw):  # rclpy would end this process with status 102
        raise RosUnavailableError(f"{RMW} is '{rmw}', which is not installed here: install it, or unset {RMW}")


def why_not_secure(environment: Mapping[str, str]) -> str | None:
    """What is left open where the security of ROS is on, and need not be; None where nothing is."""
    if environment.get(SECURITY) != "true" or environment.get(STRATEGY) == ENFORCE:
        return None
    return f"{SECURITY} is true and {STRATEGY} is not {ENFORCE}: where keys are missing ROS goes on without security"


def _is_installed(rmw: str) -> bool:
    if rmw.isidentifier() and importlib.util.find_spec(rmw) is not None:
        return True
    try:
        ctypes.CDLL(f"lib{rmw}.so")
    except OSError:
        return False
    return True


def require_packages() -> None:
    """Make sure that the packages of ROS are there.

    Raises:
        RosUnavailableError: With what is missing and how to get it.
    """
    missing = missing_packages()
    if missing:
        raise RosUnavailableError(
            f"ROS 2 is not available here (no {', '.join(missing)}): source an installation "
            "(. /opt/ros/jazzy/setup.sh), or on x86_64 install 'segway-ecc[ros]'. Everything but the ROS stage "
            "works without it: run with --no-ros"
        )


def preload() -> None:
    """Import ROS, which takes longer than all else that starts.

    Raises:
        RosUnavailableError: ROS is not there or cannot be imported.
    """
    require_ros()
    optional = [f"{TF2}.msg"] if importlib.util.find_spec(TF2) is not None else []
    try:
        for name in (*_MODULES, *optional):
            importlib.import_module(name)
    except ImportError as error:
        raise RosUnavailableError(f"ROS 2 does not start: {error}") from error


@contextlib.contextmanager
def ros_node(
    name: str,
    namespace: str,
    ros_arguments: Sequence[str] = (),
    *,
    parameters: bool = False,
    is_simulated: bool = False,
) -> Iterator[RosObject]:
    """A ROS node of its own context, without signal handlers of ROS' own.

    Args:
        name: Name of the node.
        namespace: Its namespace; relative topic names live in it.
        ros_arguments: What followed `--ros-args` on the command line, that flag included.
        parameters: Whether it offers the parameter services, which the caller has to serve, and has those parameters
            that are given on the command line.
        is_simulated: Whether `use_sim_time` is true, whatever the command line has.

    Raises:
        RosUnavailableError: ROS is not there or does not start.
    """
    require_ros()
    rclpy = importlib.import_module("rclpy")
    signals = importlib.import_module("rclpy.signals")
    context = rclpy.context.Context()
    no_signals = signals.SignalHandlerOptions.NO
    sys.modules.setdefault(_GENERATORS, None)  # type: ignore[arg-type]  # is not to be had; the package goes on without
    try:
        with udp_only():
            rclpy.init(args=list(ros_arguments), context=context, signal_handler_options=no_signals)
            node = rclpy.create_node(
                name,
                namespace=namespace or None,
                context=context,
                start_parameter_services=parameters,
                enable_rosout=False,
                automatically_declare_parameters_from_overrides=parameters,
                # No executor would ever answer the service.
                parameter_overrides=[
                    rclpy.Parameter("start_type_description_service", value=False),
                    *([rclpy.Parameter("use_sim_time", value=True)] if is_simulated else ()),
                ],
            )
    except Exception as error:  # rclpy raises whatever its C++ core does
        keys = f"; {SECURITY} is true: see ROS_SECURITY_KEYSTORE and ROS_SECURITY_ENCLAVE_OVERRIDE"
        hint = keys if os.environ.get(SECURITY) == "true" else ""
        raise RosUnavailableError(f"ROS 2 does not start: {error}{hint}") from error
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


@contextlib.contextmanager
def steady_executor(node: RosObject) -> Iterator[RosObject]:
    """An executor of a node, none of whose waits lasts more than 0.1 s longer than it was asked to.

    Fast DDS waits until a time of the wall clock: where that was set back by an hour, a wait of 0.1 s took an hour. A
    thread of ours, which waits by the monotonic clock, ends it.
    """
    executor = importlib.import_module("rclpy.executors").SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    is_over = threading.Event()

    def wake() -> None:
        while not is_over.wait(_WAKE_S):
            executor.wake()

    waker = threading.Thread(target=wake, name="waker", daemon=True)
    waker.start()
    try:
        yield executor
    finally:
        is_over.set()
        waker.join()
        executor.shutdown()


def discovery_text() -> str:
    """The settings that decide whom ROS finds, for error messages."""
    names = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
    found = [f"{name}={os.environ[name]}" for name in names if name in os.environ]
    return ", ".join(found) or "no discovery setting in the environment: domain 0, the whole subnet"


@dataclass(frozen=True, slots=True)
class Connection:
    """A topic with one node at each end; `subscriber` is empty where there is none, so is `publisher`."""

    publisher: str
    topic: str
    type_name: str
    subscriber: str


def connections(node: RosObject, namespace: str) -> list[Connection]:
    """Every topic below `namespace` with its ends, sorted."""
    found = set()
    for topic, type_names in node.get_topic_names_and_types():
        if topic in _ROS_OWN or not topic.startswith(namespace.rstrip("/") + "/"):
            continue
        publishers = [_full_name(info) for info in node.get_publishers_info_by_topic(topic)] or [""]
        subscribers = [_full_name(info) for info in node.get_subscriptions_info_by_topic(topic)] or [""]
        found |= {Connection(p, topic, t, s) for t in type_names for p in publishers for s in subscribers}
    return sorted(found, key=lambda c: (c.topic, c.publisher, c.subscriber, c.type_name))


def mismatches(node: RosObject, subscription: RosObject) -> Iterator[str]:
    """Why publishers never reach a reliable subscription of ours, each with the fix."""
    topic, kind = subscription.topic_name, subscription.msg_type
    ours = f"{kind.__module__.split('.', maxsplit=1)[0]}/msg/{kind.__name__}"
    for peer in node.get_publishers_info_by_topic(topic):
        if peer.topic_type != ours:
            is_other_twist = topic.endswith("/cmd_vel") and peer.topic_type in (TWIST_TYPE, TWIST_STAMPED_TYPE)
            setting = (
                f"set ros.cmd_vel: {peer.topic_type.rpartition('/')[2]} in the robot file, " if is_other_twist else ""
            )
            yield (
                f"{_full_name(peer)} publishes {peer.topic_type} on {topic}, which takes {ours}: they never meet. "
                f"Publish {ours}, {setting}or remap it away"
            )
        elif peer.qos_profile.reliability.name == "BEST_EFFORT":
            yield (
                f"{_full_name(peer)} publishes {topic} best-effort, and we ask for reliable: they never meet. "
                "Set its reliability to reliable"
            )


def unreached(node: RosObject, topic: str) -> Iterator[str]:
    """Why subscribers never receive what `node` publishes, reliable and volatile, on a topic; each with the fix."""
    own = node.get_fully_qualified_name()
    ours = [peer.topic_type for peer in node.get_publishers_info_by_topic(topic) if _full_name(peer) == own]
    for peer in node.get_subscriptions_info_by_topic(topic):
        if ours and peer.topic_type not in ours:
            yield (
                f"{_full_name(peer)} subscribes to {topic} as {peer.topic_type}, which is {ours[0]}: it receives "
                f"nothing. Subscribe as {ours[0]}"
            )
        elif peer.qos_profile.durability.name == "TRANSIENT_LOCAL":
            yield (
                f"{_full_name(peer)} subscribes to {topic} as transient local, and we publish volatile: it receives "
                "nothing. Set its durability to volatile"
            )


def strangers(node: RosObject, topic: str) -> tuple[list[str], int]:
    """Who else publishes a topic that `node` publishes: nodes of other names, and how many of its own beside it."""
    names = [_full_name(peer) for peer in node.get_publishers_info_by_topic(topic) if peer.node_name != UNKNOWN_NODE]
    own = node.get_fully_qualified_name()
    return sorted({name for name in names if name != own}), max(names.count(own) - 1, 0)


def namesakes(node: RosObject) -> int:
    """How many others are in ROS under the name and namespace of `node`."""
    own = node.get_name(), node.get_namespace()
    return max(list(node.get_node_names_and_namespaces()).count(own) - 1, 0)


def _full_name(info: RosObject) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


@contextlib.contextmanager
def udp_only(environment: MutableMapping[str, str] = os.environ) -> Iterator[None]:
    """Have the node that is made inside use UDP only, unless the user has chosen transports or another DDS.

    The environment is as it was afterwards: what else is started from here finds the user's own settings.
    """
    is_fast_dds = environment.get(RMW, "rmw_fastrtps_cpp").startswith("rmw_fastrtps")  # no other knows these settings
    if not is_fast_dds or any(environment.get(name) for name in (PROFILES, TRANSPORTS)) or _OWN_FILE.exists():
        yield
        return
    before = dict(environment)
    # Not a file in memory: Fast DDS asks for its real path.
    with tempfile.NamedTemporaryFile("w", prefix="segway-ecc-dds-", suffix=".xml", encoding="utf-8") as file:
        file.write(profiles_for(environment))
        file.flush()
        environment[PROFILES] = file.name
        if is_on_localhost(environment):  # where ROS would add shared memory itself: the profile has it all
            environment[RANGE] = "SYSTEM_DEFAULT"
            environment.pop(LOCALHOST_ONLY, None)
        try:
            yield
        finally:
            for name in (PROFILES, RANGE, LOCALHOST_ONLY):
                environment.pop(name, None)
                environment.update({name: before[name]} if name in before else {})


def is_on_localhost(environment: Mapping[str, str]) -> bool:
    """Whether ROS is set to find nobody beyond this machine and the peers that are named."""
    return environment.get(LOCALHOST_ONLY) == "1" or environment.get(RANGE) == "LOCALHOST"


def profiles_for(environment: Mapping[str, str]) -> str:
    """Profiles of Fast DDS with UDP as the only transport, and with the user's discovery where ROS must not set it.

    No multicast, and this machine and the peers as those who are asked: what ROS 2 Jazzy does for LOCALHOST.
    """
    discovery = ""
    if is_on_localhost(environment):
        import html  # noqa: PLC0415 - it brings a table of every character that has a name, and is seldom needed

        named = (peer.strip() for peer in environment.get(PEERS, "").split(";"))
        addresses = ["127.0.0.1", *(peer for peer in named if peer)]
        peers = "".join(_PEER_TEXT.format(address=html.escape(address)) for address in addresses)
        discovery = _DISCOVERY_TEXT.format(peers=peers)
    return _PROFILES_TEXT.format(participants=_PARTICIPANTS_ON_A_HOST, discovery=discovery)
