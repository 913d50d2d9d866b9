# SPDX-License-Identifier: MIT
"""A link through python-can and the CAN seat on the kernel's own CAN: the socketcan interface over vcan0."""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links.can_interfaces import resolve, socketcan_interfaces
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.can_ports import make_python_can_link
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.case_study.can import LockstepCanSeat, RealTimeCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.node.sequence.manoeuvre import single_segment

BITRATE = 500_000
PATIENCE_S = 60.0
ENDS_WITHIN_S = 30.0
COMMAND = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main"]


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", "set", *words], check=True)  # noqa: S607 - the guest's PATH is ours


@contextlib.contextmanager
def opened(channel: str = "vcan0") -> Iterator[CanLink]:
    link = make_python_can_link("socketcan", channel, BITRATE)
    link.open()
    try:
        yield link
    finally:
        link.close()


def receive(link: CanLink, count: int) -> list[Frame]:
    """That many frames, or those that came in time."""
    frames: list[Frame] = []
    deadline_s = time.monotonic() + PATIENCE_S
    while len(frames) < count and time.monotonic() < deadline_s:
        frames += link.receive()
    return frames


@pytest.fixture
def vcan1_down() -> Iterator[None]:
    ip_link("vcan1", "down")
    yield
    ip_link("vcan1", "up")


def test_the_interfaces_of_the_machine_are_found() -> None:
    assert socketcan_interfaces() == ["vcan0", "vcan1"]


def test_auto_picks_the_first_interface_and_says_so() -> None:
    assert resolve("auto", "auto") == ("socketcan", "vcan0")
    assert resolve("auto", "vcan1") == ("socketcan", "vcan1")
    assert resolve("auto", "elsewhere") == ("local", "elsewhere")
    assert make_python_can_link("auto", "auto", BITRATE).description == "socketcan vcan0 (chosen by 'auto auto')"


def test_a_robot_on_auto_says_that_it_is_on_vcan0() -> None:
    words = ["run", "cart-can", "--no-ros", "--no-log", "--duration", "0.05"]
    ended = subprocess.run([*COMMAND, *words], check=True, capture_output=True, text=True)

    assert "segway-ecc: robot 'cart-can' on socketcan vcan0 (chosen by 'auto auto')" in ended.stderr


def test_frames_pass_between_two_links_as_they_were_sent() -> None:
    sent = [
        Frame(0x123, bytes(range(8))),
        Frame(0x7FF, b""),
        Frame(0x1ABCDEF0, b"\xff", is_extended=True),
        Frame(0x123, b"\x01", is_extended=True),
    ]
    with opened() as sender, opened() as receiver:
        before_ns = time.monotonic_ns()
        assert all(sender.send(frame) for frame in sent)
        received = receive(receiver, len(sent))
        after_ns = time.monotonic_ns()

        assert [replace(frame, received_ns=0) for frame in received] == sent
        assert sender.counters.sent == receiver.counters.received == len(sent)
        # Stamped by the kernel when they were received, on the loop's clock.
        stamps = [frame.received_ns for frame in received]
        assert stamps == sorted(stamps)
        assert all(before_ns - 1_000_000 <= stamp_ns <= after_ns for stamp_ns in stamps)


def test_a_link_does_not_hear_itself() -> None:
    with opened() as sender, opened() as witness:
        sender.send(Frame(0x123, b"\x01"))
        assert len(receive(witness, 1)) == 1
        # The witness has it, so the kernel has handed it out to all.
        assert sender.receive() == []


def test_the_interfaces_are_buses_of_their_own() -> None:
    with opened("vcan0") as sender, opened("vcan0") as witness, opened("vcan1") as elsewhere:
        sender.send(Frame(0x123, b"\x01"))
        assert len(receive(witness, 1)) == 1
        assert elsewhere.receive() == []


def test_an_interface_that_is_set_down_is_a_lost_link() -> None:
    with opened("vcan1") as link:
        ip_link("vcan1", "down")
        try:
            with pytest.raises(LinkLostError, match=r"^CAN bus socketcan vcan1 is gone: "):
                link.receive()
            assert link.send(Frame(0x123, b"\x01")) is False
            assert link.counters.send_dropped == 1
        finally:
            ip_link("vcan1", "up")


def test_an_interface_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(BusNotFoundError) as caught:
        make_python_can_link("socketcan", "nosuch0", BITRATE).open()

    assert str(caught.value) == (
        "no CAN interface is called 'nosuch0'; there is vcan0, vcan1. "
        "Use interface: auto for a virtual bus, or set the interface up first"
    )


@pytest.mark.usefixtures("vcan1_down")
def test_an_interface_that_is_down_is_told_with_the_command_that_sets_it_up() -> None:
    with pytest.raises(BusNotFoundError) as caught:
        make_python_can_link("socketcan", "vcan1", BITRATE).open()

    assert str(caught.value).startswith("CAN interface vcan1 is down; set it up: sudo ip link set vcan1 up")


@pytest.mark.usefixtures("vcan1_down")
def test_the_command_line_tells_a_bus_that_is_down_in_one_line() -> None:
    words = ["plant", "cart-can", "--channel", "vcan1"]
    ended = subprocess.run([*COMMAND, *words], check=False, capture_output=True, text=True)

    assert ended.returncode == 4
    (line,) = ended.stderr.splitlines()
    assert line.startswith("segway-ecc: CAN interface vcan1 is down; ")


@pytest.mark.proof  # in real time in a slow kernel: how it goes depends on what else the machine does
def test_plant_and_controller_over_vcan_end_where_the_model_does(tmp_path: Path) -> None:
    manoeuvre = single_segment(1.0, 0.5, 2.0)
    file, truth = tmp_path / "drive.yaml", tmp_path / "truth.csv"
    file.write_text("segments: [{linear: 1.0, angular: 0.5, duration: 2.0}]\n", "utf-8")
    plant_words = ["plant", "cart-can", "--channel", "vcan0", "--truth", str(truth), "--json"]
    node_words = ["run", "cart-can", "--channel", "vcan0", "--no-ros", "--no-log", "--sequence", str(file), "--json"]
    with subprocess.Popen([*COMMAND, *plant_words], stdout=subprocess.PIPE, text=True) as plant:
        try:
            node = subprocess.run(
                [*COMMAND, *node_words], check=True, capture_output=True, text=True, timeout=ENDS_WITHIN_S
            )
        finally:
            plant.terminate()
            said, _ = plant.communicate(timeout=ENDS_WITHIN_S)
    offline = OfflineSeat(tmp_path).run("same", manoeuvre)
    result = json.loads(node.stdout)

    assert result["stop_reason"] == "the sequence is over"
    assert "on socketcan vcan0" in node.stderr
    assert json.loads(said)["refused_frames"] == 0
    rows = [line.split(",") for line in truth.read_text("utf-8").splitlines()]
    x, y = rows[0].index("truth.x"), rows[0].index("truth.y")
    # The last tick not after the end: a tick of 5 ms at 1 m/s is far less than what is allowed.
    end_ns = result["sequence"]["started_wall_ns"] + manoeuvre.duration_ns
    end = [row for row in rows[1:] if int(row[0]) <= end_ns][-1]
    assert (float(end[x]), float(end[y])) == pytest.approx(offline.position, abs=0.05)


def test_the_case_study_takes_turns_on_the_interface(tmp_path: Path) -> None:
    assert RealTimeCanSeat(tmp_path, tmp_path).jobs == 1


@pytest.mark.parametrize("name", ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402", "cart-moteus"])
def test_frames_over_vcan_drive_the_cart_as_those_of_the_simulated_bus_do(name: str) -> None:
    """Controller and plant on a simulated clock, with the kernel between them: no load can disturb this one."""
    manoeuvre = single_segment(2.0, 2.0, 2.0)
    over_vcan = LockstepCanSeat(None, name, ("vcan0", "vcan0")).run("same", manoeuvre)
    simulated = LockstepCanSeat(None, name).run("same", manoeuvre)
    assert over_vcan.position == pytest.approx(simulated.position, abs=0.02)
