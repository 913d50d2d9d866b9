# SPDX-License-Identifier: MIT
import dataclasses
from typing import Any

import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.hardware import check_can
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState
from segway_ecc.firmware_io.links.link import LinkState
from tests.deploy.doctor.fake_machine import GOOD_CAN, FakeMachine, by_name, workload


def looked(fake: FakeMachine, robot: str | None = "cart-can", **can: object) -> dict[str, Finding]:
    return by_name(list(check_can(fake.machine, workload(fake.root, robot, can=can))))


def changed(**values: object) -> InterfaceState:
    return dataclasses.replace(GOOD_CAN, **values)  # type: ignore[arg-type]


def not_good(found: dict[str, Finding]) -> dict[str, Verdict]:
    return {name: each.verdict for name, each in found.items() if each.verdict is not Verdict.GOOD}


def test_all_is_well(fake: FakeMachine) -> None:
    assert {name: each.found for name, each in looked(fake).items()} == {
        "CAN can0": "up, active",
        "CAN can0 bit rate": "500000 bit/s",
        "CAN can0 restart": "100 ms after bus-off",
        "CAN can0 queue": "16 frames",
    }
    assert not not_good(looked(fake))


def test_down(fake: FakeMachine) -> None:
    fake.interface("can0", changed(is_up=False, state=None))
    found = looked(fake)
    assert not_good(found) == {"CAN can0": Verdict.BAD}
    assert found["CAN can0"].found == "down"
    assert found["CAN can0"].remedy == (
        "sudo ip link set can0 down; sudo ip link set can0 up txqueuelen 16 type can bitrate 500000 restart-ms 100"
    )


@pytest.mark.parametrize(("actual", "wanted"), [(250_000, 1_000_000), (1_000_000, 250_000)])
def test_the_wrong_bit_rate(fake: FakeMachine, actual: int, wanted: int) -> None:
    fake.interface("can0", changed(bitrate=actual))
    found = looked(fake, bitrate=wanted)
    assert not_good(found) == {"CAN can0 bit rate": Verdict.BAD}
    assert found["CAN can0 bit rate"].found == f"{actual} bit/s, the robot file has {wanted}"
    assert f"type can bitrate {wanted} restart-ms 100" in found["CAN can0 bit rate"].remedy


def test_unreported_bit_rate_is_warned(fake: FakeMachine) -> None:
    fake.interface("can0", changed(bitrate=None))
    assert not_good(looked(fake)) == {"CAN can0 bit rate": Verdict.WARNING}


@pytest.mark.parametrize(
    ("state", "verdict"),
    [(LinkState.BUS_OFF, Verdict.BAD), (LinkState.PASSIVE, Verdict.WARNING), (LinkState.WARNING, Verdict.WARNING)],
)
def test_an_ailing_bus(fake: FakeMachine, state: LinkState, verdict: Verdict) -> None:
    fake.interface("can0", changed(state=state, tec=248, rec=7))
    found = looked(fake)
    assert not_good(found) == {"CAN can0": verdict}
    assert found["CAN can0"].found == f"up, {state}, error counters 248 sent and 7 received"
    assert "120 ohm" in found["CAN can0"].remedy


@pytest.mark.parametrize("restart_ms", [0, None])
def test_no_restart(fake: FakeMachine, restart_ms: int | None) -> None:
    fake.interface("can0", changed(restart_ms=restart_ms))
    assert not_good(looked(fake)) == {"CAN can0 restart": Verdict.WARNING}


@pytest.mark.parametrize(("length", "is_good"), [(7, False), (8, True), (64, True), (65, False), (1000, False)])
def test_the_queue(fake: FakeMachine, length: int, is_good: bool) -> None:  # noqa: FBT001 - a parameter of the test
    fake.interface("can0", GOOD_CAN, queue=length)
    found = looked(fake)
    assert not_good(found) == ({} if is_good else {"CAN can0 queue": Verdict.WARNING})
    assert is_good or found["CAN can0 queue"].remedy == "sudo ip link set can0 txqueuelen 16"


def test_a_virtual_interface_has_no_controller(fake: FakeMachine) -> None:
    fake.interface("vcan0", InterfaceState("vcan", is_up=True))
    found = looked(fake, channel="vcan0")
    assert list(found) == ["CAN vcan0", "CAN vcan0 kind"]
    assert not_good(found) == {"CAN vcan0 kind": Verdict.WARNING}


def test_an_interface_that_is_not_there(fake: FakeMachine) -> None:
    fake.interface("eth0", InterfaceState("", is_up=True), is_can=False)
    found = looked(fake, channel="eth0")
    assert not_good(found) == {"CAN eth0": Verdict.BAD}
    assert found["CAN eth0"].found == "not there; there is can0"


def test_auto_is_the_first_interface(fake: FakeMachine) -> None:
    fake.interface("can1", changed(state=LinkState.BUS_OFF))
    assert not not_good(looked(fake, channel="auto"))
    assert not_good(looked(fake, channel="can1", interface="socketcan")) == {"CAN can1": Verdict.BAD}


def test_auto_without_any_interface_is_no_robot(fake: FakeMachine) -> None:
    fake.remove("/sys/class/net/can0/type")
    found = looked(fake)
    assert not_good(found) == {"CAN can0": Verdict.BAD}
    assert found["CAN can0"].found == "not there; this machine has no CAN interface"


@pytest.mark.parametrize("interface", ["local", "kvaser"])
def test_what_is_no_interface_of_the_kernel_cannot_be_looked_at(fake: FakeMachine, interface: str) -> None:
    found = looked(fake, interface=interface, channel="7")
    assert not_good(found) == {"CAN interface": Verdict.WARNING}
    assert found["CAN interface"].found == f"{interface} 7, which is no interface of the kernel"


def test_a_robot_that_is_all_model_needs_none(fake: FakeMachine) -> None:
    fake.interface("can0", changed(state=LinkState.BUS_OFF))
    assert {name: each.verdict for name, each in looked(fake, "cart").items()} == {"CAN interface": Verdict.GOOD}


def test_without_a_robot_every_interface_is_looked_at(fake: FakeMachine) -> None:
    fake.interface("can1", changed(is_up=False, bitrate=125_000))
    found = looked(fake, None)
    assert not_good(found) == {"CAN can1": Verdict.BAD}
    assert found["CAN can0 bit rate"].found == "500000 bit/s"


def test_without_a_robot_and_without_an_interface(fake: FakeMachine) -> None:
    fake.remove("/sys/class/net/can0/type")
    assert not_good(looked(fake, None)) == {"CAN interface": Verdict.WARNING}


FD: dict[str, Any] = {"bitrate": 1_000_000, "fd": True, "data_bitrate": 5_000_000}


def test_an_interface_of_can_fd_has_both_bit_rates(fake: FakeMachine) -> None:
    fake.interface("can0", changed(bitrate=1_000_000, data_bitrate=5_000_000))
    found = looked(fake, **FD)
    assert not not_good(found)
    assert found["CAN can0 data bit rate"].found == "5000000 bit/s"


@pytest.mark.parametrize(
    ("data_bitrate", "text"),
    [
        (None, "none: it carries classic frames only"),
        (2_000_000, "2000000 bit/s, the robot file has 5000000"),
    ],
)
def test_the_wrong_bit_rate_of_data_is_named_with_the_command(
    fake: FakeMachine, data_bitrate: int | None, text: str
) -> None:
    fake.interface("can0", changed(bitrate=1_000_000, data_bitrate=data_bitrate))
    found = looked(fake, **FD)
    assert not_good(found) == {"CAN can0 data bit rate": Verdict.BAD}
    assert found["CAN can0 data bit rate"].found == text
    assert "type can bitrate 1000000 dbitrate 5000000 fd on restart-ms 100" in found["CAN can0 data bit rate"].remedy


def test_unreported_bit_rates_are_warned(fake: FakeMachine) -> None:
    fake.interface("can0", changed(bitrate=None))
    assert not_good(looked(fake, **FD)) == {
        "CAN can0 bit rate": Verdict.WARNING,
        "CAN can0 data bit rate": Verdict.WARNING,
    }
