# SPDX-License-Identifier: MIT
import socket
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links import can_interfaces
from segway_ecc.firmware_io.links.can_interfaces import resolve, socketcan_interfaces
from segway_ecc.firmware_io.links.can_ports import make_can_link, make_python_can_link
from segway_ecc.firmware_io.links.link import Link

UP, DOWN = "0x40081", "0x40080"
"""Flags of linux/if.h and if_arp.h as sysfs prints them; the last bit is IFF_UP."""


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for /sys/class/net, with no CAN interface in it yet."""
    for name, kind in (("lo", "772"), ("eth0", "1")):
        _add_device(tmp_path, name, kind)
    (tmp_path / "vanished").mkdir()
    monkeypatch.setattr(can_interfaces, "NETWORK_DEVICES", tmp_path)
    return tmp_path


def _add_device(devices: Path, name: str, kind: str = "280", flags: str = UP) -> None:
    (devices / name).mkdir()
    (devices / name / "type").write_text(f"{kind}\n")
    (devices / name / "flags").write_text(f"{flags}\n")


@pytest.mark.parametrize(
    ("interface", "channel", "present", "expected"),
    [
        ("auto", "auto", [], ("local", "robot")),
        ("auto", "auto", ["vcan1", "can0"], ("socketcan", "can0")),
        ("auto", "can1", ["can0", "can1"], ("socketcan", "can1")),
        ("auto", "bench", ["can0"], ("local", "bench")),
        ("auto", "eth0", ["can0"], ("local", "eth0")),
        ("socketcan", "auto", ["vcan0"], ("socketcan", "vcan0")),
        ("socketcan", "can9", ["can0"], ("socketcan", "can9")),
        ("virtual", "auto", ["can0"], ("virtual", "robot")),
        ("virtual", "can0", ["can0"], ("virtual", "can0")),
    ],
)
def test_auto_is_a_real_bus_where_there_is_one(
    devices: Path, interface: str, channel: str, present: list[str], expected: tuple[str, str]
) -> None:
    for name in present:
        _add_device(devices, name, flags=DOWN)
    assert socketcan_interfaces() == sorted(present)
    assert resolve(interface, channel) == expected


def test_the_kernels_can_and_the_virtual_bus_go_over_a_raw_socket_and_all_else_through_python_can(
    devices: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []

    def refuse(*kind: int) -> None:
        opened.append(kind)
        raise OSError("no sockets")

    def python_can(**options: object) -> None:
        opened.append(options["interface"])

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(can, "Bus", python_can)
    make_can_link("virtual", "x", 500_000).open()
    virtual = make_can_link("auto", "auto", 500_000)
    assert virtual.description == "local robot (chosen by 'auto auto')"
    _add_device(devices, "can0")
    chosen = make_can_link("auto", "auto", 500_000), make_can_link("socketcan", "can0", 500_000)
    assert [link.description for link in chosen] == ["socketcan can0 (chosen by 'auto auto')", "socketcan can0"]
    for link in (virtual, *chosen):
        with pytest.raises(BusNotFoundError, match="no sockets"):
            link.open()
    raw = (socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    assert opened == ["virtual", (socket.AF_INET, socket.SOCK_DGRAM), raw, raw]
    assert make_can_link("socketcan", "can0", 500_000).description == "socketcan can0"


def test_description_has_the_choice_and_its_reason(devices: Path) -> None:
    assert make_python_can_link("auto", "auto", 500_000).description == "local robot (chosen by 'auto auto')"
    _add_device(devices, "can0")
    assert make_python_can_link("auto", "can0", 500_000).description == "socketcan can0 (chosen by 'auto can0')"
    assert make_python_can_link("virtual", "x", 500_000).description == "virtual x"


@pytest.mark.parametrize(
    ("present", "found"), [([], "this machine has no CAN interface"), (["can0", "vcan1"], "there is can0, vcan1")]
)
@pytest.mark.parametrize("make", [make_python_can_link, make_can_link])
def test_missing_interface_is_one_line_with_the_remedy(
    devices: Path, present: list[str], found: str, make: Callable[[str, str, int], Link]
) -> None:
    for name in present:
        _add_device(devices, name)
    with pytest.raises(BusNotFoundError) as error:
        make("socketcan", "can7", 500_000).open()
    expected = (
        f"no CAN interface is called 'can7'; {found}. Use interface: auto for a virtual bus, or set the interface"
    )
    assert str(error.value) == f"{expected} up first"


@pytest.mark.parametrize("make", [make_python_can_link, make_can_link])
def test_an_interface_that_is_down_is_one_line_with_the_command(
    devices: Path, make: Callable[[str, str, int], Link]
) -> None:
    _add_device(devices, "can0", flags=DOWN)
    with pytest.raises(BusNotFoundError) as error:
        make("socketcan", "can0", 250_000).open()
    command = "sudo ip link set can0 up type can bitrate 250000"
    assert str(error.value) == f"CAN interface can0 is down; set it up: {command}"


def test_an_interface_that_goes_while_it_is_looked_at_is_down(devices: Path) -> None:
    _add_device(devices, "can0")
    (devices / "can0" / "flags").unlink()
    with pytest.raises(BusNotFoundError, match=r"^CAN interface can0 is down; "):
        make_can_link("socketcan", "can0", 500_000).open()


@pytest.mark.parametrize("interface", ["no-such-interface", "slcan", "kvaser", "robotell", "socketcand"])
def test_a_bus_that_cannot_be_opened_is_one_line_that_names_it(interface: str) -> None:
    with pytest.raises(BusNotFoundError, match=f"^cannot open CAN bus {interface} /no/such/port: .+") as error:
        make_python_can_link(interface, "/no/such/port", 500_000).open()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [can.CanInitializationError, OSError, ValueError, ImportError, NameError, TypeError])
def test_whatever_a_backend_raises_on_opening_is_ours(monkeypatch: pytest.MonkeyPatch, kind: type[Exception]) -> None:
    def fail(**_: object) -> None:
        raise kind("out of order")

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(BusNotFoundError, match="cannot open CAN bus fake here: out of order"):
        make_python_can_link("fake", "here", 500_000).open()


@pytest.mark.parametrize(("interface", "more"), [("fake", {}), ("slcan", {"timeout": 0.0})])
def test_bit_rate_reaches_the_backend_and_slcan_does_not_wait(
    monkeypatch: pytest.MonkeyPatch, interface: str, more: dict[str, object]
) -> None:
    asked: dict[str, object] = {}
    monkeypatch.setattr(can, "Bus", lambda **options: asked.update(options))
    make_python_can_link(interface, "here", 125_000).open()
    assert asked == {"channel": "here", "interface": interface, "bitrate": 125_000, **more}


@pytest.mark.parametrize("flags", [UP, "0x1"])
def test_an_interface_that_is_up_is_opened(devices: Path, monkeypatch: pytest.MonkeyPatch, flags: str) -> None:
    _add_device(devices, "can0", flags=flags)
    asked: dict[str, object] = {}
    monkeypatch.setattr(can, "Bus", lambda **options: asked.update(options))
    make_python_can_link("auto", "auto", 500_000).open()
    assert asked == {"channel": "can0", "interface": "socketcan", "bitrate": 500_000}
