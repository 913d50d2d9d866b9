# SPDX-License-Identifier: MIT
"""How DDS carries messages between processes of one machine: not through shared memory.

Where Fast DDS meets another participant on its machine, it looks after the health of the shared-memory port between
them, and whoever publishes meanwhile waits: about 330 ms were measured in the publishing of a loop as robots and a
station found each other (Fast DDS issue 6535). A robot that balances cannot wait that long, so our processes use UDP.
Others on the machine need no setting: they use shared memory among themselves and UDP with ours.
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import Final

PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Names the file of profiles that Fast DDS 2.14 reads when the process makes its first participant."""

TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
RMW: Final = "RMW_IMPLEMENTATION"
RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS: Final = "ROS_STATIC_PEERS"
LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"

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


@contextlib.contextmanager
def udp_only(environment: MutableMapping[str, str] = os.environ) -> Iterator[None]:
    """Have the node that is made inside use UDP only, unless the user has chosen transports or another DDS.

    The environment is as it was afterwards: what else is started from here finds the user's own settings.
    """
    if is_chosen(environment):
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


def is_chosen(environment: Mapping[str, str]) -> bool:
    """Whether the user has chosen which transports to use, or uses a DDS that knows nothing of these settings."""
    is_fast_dds = environment.get(RMW, "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
    return not is_fast_dds or any(environment.get(name) for name in (PROFILES, TRANSPORTS)) or _OWN_FILE.exists()


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
