"""Getting the drives ready before the loop starts: reset, set up, communication started."""

from collections.abc import Callable, Sequence
from typing import Final

from segway_ecc.firmware_io.drives.cia402.frames import NmtCommand, Service, pack_nmt
from segway_ecc.firmware_io.drives.cia402.limits import BOOT_WITHIN_NS, SETTLE_NS
from segway_ecc.firmware_io.drives.cia402.network import LinkNetwork
from segway_ecc.firmware_io.drives.cia402.restoring import Restoring
from segway_ecc.firmware_io.drives.cia402.settings import SetUpPlan
from segway_ecc.firmware_io.drives.cia402.setup import SetUpError, set_up
from segway_ecc.firmware_io.drives.cia402.wheel import Cia402Wheel
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link

_ATTEMPTS: Final = 3


def commission(
    link: Link,
    wheels: Sequence[Cia402Wheel],
    plans: Sequence[SetUpPlan],
    now_ns: Callable[[], int],
    sleep_until_ns: Callable[[int], None],
) -> None:
    """Reset the drives' communication, set each up by its plan and start it; blocks.

    The reset makes the set-up begin from the same state every time, as it does after the drive was switched on. Why a
    drive could not be set up is left as its `trouble`.
    """
    network = LinkNetwork(link, now_ns, sleep_until_ns)
    for wheel in wheels:
        link.send(_nmt(NmtCommand.RESET_COMMUNICATION, wheel))
    try:
        network.wait_until(lambda: all(network.boots[wheel.node_id] for wheel in wheels), BOOT_WITHIN_NS)
        # A drive that was switched on a moment ago reports that, and then the reset.
        network.wait_until(lambda: False, SETTLE_NS)
    except LinkLostError as error:
        for wheel in wheels:
            wheel.trouble = str(error)
        return
    boots = [_set_up(network, wheel, plan, now_ns) for wheel, plan in zip(wheels, plans, strict=True)]
    for wheel, booted in zip(wheels, boots, strict=True):
        if wheel.trouble is None and network.boots[wheel.node_id] != booted:
            wheel.restart()
        elif wheel.trouble is None:
            link.send(_nmt(NmtCommand.START, wheel))


def _set_up(network: LinkNetwork, wheel: Cia402Wheel, plan: SetUpPlan, now_ns: Callable[[], int]) -> int:
    """Set a drive up, anew where it restarts meanwhile; how often it had started when that began."""
    for _ in range(_ATTEMPTS):
        booted = network.boots[plan.node_id]
        network.exchanges[plan.node_id] = []
        try:
            wheel.rated_torque = set_up(network, plan)
        except (SetUpError, LinkLostError) as error:
            wheel.trouble = str(error)
        else:
            wheel.trouble = None
        if network.boots[plan.node_id] == booted:
            break
    else:
        wheel.trouble = "it restarts again and again"
    if wheel.trouble is None:
        wheel.restoring = Restoring(network.exchanges[plan.node_id], now_ns)
    return booted


def _nmt(command: NmtCommand, wheel: Cia402Wheel) -> Frame:
    return Frame(Service.NMT, pack_nmt(command, wheel.node_id))
