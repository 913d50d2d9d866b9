# SPDX-License-Identifier: MIT
"""The guest's kernel is PREEMPT_RT, and frames pass between its two CAN controllers through the real driver."""

import errno
import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import can
import pytest

BITRATE = 500_000
PATIENCE_S = 10.0
QUIET_S = 0.2
NETWORK_DEVICES = Path("/sys/class/net")
DRIVER = Path("/sys/bus/pci/drivers/kvaser_pci")
GONE = {errno.ENODEV, errno.ENXIO, errno.ENETDOWN}
BYTES = bytes(range(0xF8, 0x100))

DATA = [can.Message(arbitration_id=0x123, data=BYTES[:length], is_extended_id=False) for length in range(9)]
EXTENDED = [can.Message(arbitration_id=0x1234_5678, data=BYTES[:length]) for length in range(9)]
EDGES = [
    can.Message(arbitration_id=number, is_extended_id=number > 0x7FF) for number in (0, 1, 0x7FF, 0x800, (1 << 29) - 1)
]
LOW_EXTENDED = [can.Message(arbitration_id=0x123, data=b"\x01", is_extended_id=True)]
# Of length 0 alone: see hil/kernels/qemu.py.
REMOTE = [
    can.Message(arbitration_id=0x123, is_remote_frame=True, is_extended_id=extended) for extended in (False, True)
]
EVERY_BYTE = [
    can.Message(arbitration_id=0x321, data=bytes(range(first, first + 8)), is_extended_id=False)
    for first in range(0, 256, 8)
]
FRAMES = [*DATA, *EXTENDED, *EDGES, *LOW_EXTENDED, *REMOTE, *EVERY_BYTE]


class Content(NamedTuple):
    """What of a frame is on the wire."""

    arbitration_id: int
    is_extended: bool
    is_remote: bool
    is_error: bool
    length: int
    data: bytes


def content(message: can.Message) -> Content:
    flags = (message.is_extended_id, message.is_remote_frame, message.is_error_frame)
    return Content(message.arbitration_id, *flags, message.dlc, bytes(message.data))


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", "set", *words], check=True)  # noqa: S607 - the guest's PATH is ours


def described(channel: str) -> dict[str, Any]:
    words = ["ip", "-json", "-details", "link", "show", channel]
    (link,) = json.loads(subprocess.run(words, check=True, capture_output=True).stdout)
    return dict(link)


def opened(channel: str) -> can.BusABC:
    return can.Bus(interface="socketcan", channel=channel)


def receive(bus: can.BusABC) -> Content | None:
    message = bus.recv(PATIENCE_S)
    return None if message is None else content(message)


def loss(bus: can.BusABC) -> int | None:
    """The error number with which the bus tells that it is lost."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            bus.recv(QUIET_S)
        except can.CanError as error:
            return error.error_code
    return None


def frames_pass() -> None:
    with opened("can0") as can0, opened("can1") as can1:
        for sender, receiver in ((can0, can1), (can1, can0)):
            sender.send(DATA[8])
            assert receive(receiver) == content(DATA[8])


@pytest.fixture
def can1_comes_back() -> Iterator[None]:
    yield
    ip_link("can1", "up")


def test_the_kernel_is_preempt_rt() -> None:
    assert Path("/sys/kernel/realtime").read_text("ascii") == "1\n"


@pytest.mark.parametrize("channel", ["can0", "can1"])
def test_the_controllers_are_driven_as_real_cards_are(channel: str) -> None:
    assert (NETWORK_DEVICES / channel / "device" / "driver").resolve().name == "kvaser_pci"
    assert described(channel)["linkinfo"]["info_data"]["bittiming_const"]["name"] == "sja1000"


@pytest.mark.parametrize("channel", ["can0", "can1"])
def test_the_controllers_are_set_up_as_a_robots_are(channel: str) -> None:
    link = described(channel)
    controller = link["linkinfo"]["info_data"]

    assert link["txqlen"] == 16
    assert controller["bittiming"]["bitrate"] == BITRATE
    assert controller["restart_ms"] == 100
    assert controller["ctrlmode"] == ["BERR-REPORTING"]


@pytest.mark.parametrize("channel", ["can0", "can1"])
def test_state_and_error_counters_can_be_read(channel: str) -> None:
    controller = described(channel)["linkinfo"]["info_data"]

    assert controller["state"] == "ERROR-ACTIVE"
    assert controller["berr_counter"] == {"tx": 0, "rx": 0}


@pytest.mark.parametrize(("source", "destination"), [("can0", "can1"), ("can1", "can0")])
def test_frames_pass_byte_for_byte(source: str, destination: str) -> None:
    with opened(source) as sender, opened(destination) as receiver:
        for frame in FRAMES:
            sender.send(frame)
            assert receive(receiver) == content(frame)
        assert receiver.recv(QUIET_S) is None
        assert sender.recv(0) is None


def test_frames_go_through_the_controllers() -> None:
    def counts() -> tuple[int, int]:
        sent, received = (
            int((NETWORK_DEVICES / path).read_text("ascii"))
            for path in ("can0/statistics/tx_packets", "can1/statistics/rx_packets")
        )
        return sent, received

    sent, received = counts()
    with opened("can0") as sender, opened("can1") as receiver:
        for _ in range(10):
            sender.send(DATA[8])
            assert receive(receiver) == content(DATA[8])

    # The sender's own count is raised by an interrupt that may come after the frame has arrived.
    deadline = time.monotonic() + PATIENCE_S
    while counts() != (sent + 10, received + 10) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert counts() == (sent + 10, received + 10)


@pytest.mark.usefixtures("can1_comes_back")
def test_an_interface_that_is_set_down_says_so_and_comes_back() -> None:
    with opened("can1") as bus:
        ip_link("can1", "down")
        assert loss(bus) == errno.ENETDOWN
        with pytest.raises(can.CanOperationError) as refusal:
            bus.send(DATA[8])
        assert refusal.value.error_code == errno.ENETDOWN
    assert described("can1")["linkinfo"]["info_data"]["state"] == "STOPPED"

    ip_link("can1", "up")

    assert described("can1")["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    frames_pass()


def test_a_controller_that_is_taken_away_says_so_and_comes_back() -> None:
    slot = (NETWORK_DEVICES / "can1" / "device").resolve().name
    with opened("can1") as bus:
        (DRIVER / "unbind").write_text(slot, "ascii")
        assert not (NETWORK_DEVICES / "can1").exists()
        assert loss(bus) in GONE

    (DRIVER / "bind").write_text(slot, "ascii")
    ip_link("can1", "type", "can", "bitrate", str(BITRATE), "restart-ms", "100")
    ip_link("can1", "type", "can", "berr-reporting", "on")
    ip_link("can1", "txqueuelen", "16")
    ip_link("can1", "up")

    frames_pass()
