# SPDX-License-Identifier: MIT
"""What makers' drives differ in: identity, modes of operation and their refusal, and the period of the set-points."""

import pytest

from segway_ecc.firmware_io.drives.cia402.frames import DriveState
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.hil.devices.cia402 import TICK_NS, DriveKind, SimulatedCia402
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot
from tests.hil.devices.cia402_faults import latch_fault
from tests.hil.devices.test_cia402 import LEFT, RIGHT, Bench

PROFILE_ONLY = DriveKind(modes=(4,))
SET_MODE_10, READ_MODE, READ_REQUEST = "2f6060000a000000", "4061600000000000", "4060600000000000"


def booted(kind: DriveKind | None = None) -> Bench:
    bench = Bench(kind)
    bench.tick()
    return bench


@pytest.mark.parametrize("node", [LEFT, RIGHT])
def test_identity_has_four_parts_and_the_node_is_the_serial_number(node: int) -> None:
    requests = [f"401810{part:02x}00000000" for part in range(6)]
    assert booted().ask(*requests, node=node) == [
        "4f18100004000000",
        "4318100100000000",
        "4318100292010000",
        "4318100300000100",
        f"43181004{node:02x}000000",
        "8018100511000906",
    ]


@pytest.mark.parametrize(
    ("kind", "answer"),
    [
        (DriveKind(), "4302650000020000"),
        (PROFILE_ONLY, "4302650008000000"),
        (DriveKind(modes=(1, 3, 4, 8, 9, 10)), "430265008d030000"),
        (DriveKind(lacks=(0x6502,)), "8002650000000206"),
    ],
)
def test_supported_modes_are_a_bit_each(kind: DriveKind, answer: str) -> None:
    assert booted(kind).ask("4002650000000000") == [answer]


def test_another_mode_is_refused_and_the_old_one_stays() -> None:
    bench = booted(PROFILE_ONLY)
    assert bench.ask("2f60600004000000", SET_MODE_10) == ["6060600000000000", "8060600030000906"]
    assert bench.ask(READ_REQUEST, READ_MODE) == ["4f60600004000000", "4f61600004000000"]


def test_another_mode_may_be_accepted_in_silence_and_never_become_the_mode() -> None:
    bench = booted(DriveKind(modes=(4,), keeps_mode_silently=True))
    assert [bench.ask(request) for request in ("2f60600004000000", SET_MODE_10)] == [["6060600000000000"]] * 2
    assert bench.ask(READ_REQUEST, READ_MODE) == ["4f6060000a000000", "4f61600004000000"]


def enabled(kind: DriveKind, mode: str, *more: str) -> Bench:
    """Both drives in operation in a mode, after more requests; SYNC comes every 4 ms."""
    bench = booted(kind)
    bench.map()
    for node in (LEFT, RIGHT):
        assert all(answer.startswith("60") for answer in bench.ask(mode, *more, node=node))
    bench.tick((0x000, "0100"))
    for controlword in (0x06, 0x07, 0x0F):
        bench.command(controlword)
        bench.tick(times=3)
    return bench


def test_profile_torque_goes_to_its_target_with_the_slope() -> None:
    kind = DriveKind(modes=(4, 10))
    bench = enabled(kind, "2f60600004000000", "23876000d0070000")  # 2000 thousandths a second, 2 a tick
    assert bench.states() == [DriveState.OPERATION_ENABLED] * 2
    given = []
    for _ in range(5):
        bench.command(0x0F, 5)
        given.append(bench.drives.axes["left"].torque)
    assert given == pytest.approx([step * 1.5e-3 for step in (2, 4, 5, 5, 5)])
    bench.command(0x06)
    assert bench.drives.axes["left"].torque == 0.0


def test_cyclic_torque_is_the_target_at_once() -> None:
    bench = enabled(DriveKind(modes=(4, 10)), SET_MODE_10)
    bench.command(0x0F, 500)
    assert bench.drives.axes["left"].torque == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("needs", "period", "exponent", "state"),
    [
        (False, 1, 0xFD, DriveState.OPERATION_ENABLED),
        (True, 4, 0xFD, DriveState.OPERATION_ENABLED),
        (True, 40, 0xFC, DriveState.OPERATION_ENABLED),
        (True, 1, 0xFD, DriveState.FAULT),
        (True, 10, 0xFD, DriveState.FAULT),
    ],
)
def test_the_period_of_the_set_points_may_have_to_be_that_of_sync(
    *,
    needs: bool,
    period: int,
    exponent: int,
    state: DriveState,
) -> None:
    kind = DriveKind(needs_sync_period=needs)
    bench = enabled(kind, SET_MODE_10, f"2fc26001{period:02x}000000", f"2fc26002{exponent:02x}000000")
    assert bench.states() == [state] * 2


def test_a_wrong_period_is_told_by_emergency_and_in_the_error_register() -> None:
    bench = enabled(DriveKind(needs_sync_period=True), SET_MODE_10)
    assert bench.states() == [DriveState.FAULT] * 2
    assert bench.ask("4001100000000000") == ["4f01100021000000"]


def test_the_error_register_shows_what_the_emergency_said_until_the_fault_is_reset() -> None:
    bench = booted()
    latch_fault(bench.drives.axes["left"])
    frames = bench.tick()
    assert (0x081, "1023030000000000") in frames
    assert bench.ask("4001100000000000") == ["4f01100003000000"]
    bench.ask("2b40600080000000")
    assert bench.ask("4001100000000000") == ["4f01100000000000"]


def test_an_object_that_is_lacking_is_not_there() -> None:
    assert booted(DriveKind(lacks=(0x1018,))).ask("4018100100000000") == ["8018100100000206"]


@pytest.mark.parametrize(
    ("kind", "refusal"),
    [
        (DriveKind(), ""),
        (DriveKind(needs_sync_period=True), ""),
        (DriveKind(modes=(4, 10)), ""),
        (PROFILE_ONLY, "profile torque alone is not enough"),
        (DriveKind(modes=(4,), lacks=(0x6502,)), "it refuses it: "),
        (DriveKind(modes=(4,), lacks=(0x6502,), keeps_mode_silently=True), "it stays in mode 0"),
    ],
)
def test_the_cart_arms_on_drives_that_have_cyclic_torque_and_names_those_that_do_not(
    kind: DriveKind, refusal: str
) -> None:
    file = load_robot("cart-cia402")
    assert isinstance(file.hardware, Cia402Settings)
    rig = LockstepRig(file.hardware.can.bitrate)
    end = rig.bus.attach("drives")
    device = SimulatedCia402(end, file.hardware, kind=kind)
    rig.attach(SimulatedRobot(end, [device], simulated_plant(file), TICK_NS))
    hardware = build_robot(file, rig, rig.bus.attach("node")).hardware
    hardware.open()
    for _ in range(30):
        rig.sleep_until_ns(rig.now_ns() + 10_000_000)
        hardware.exchange((0.0, 0.0))
    failures = hardware.arming_failures()
    assert [refusal in failure for failure in failures] == ([True, True] if refusal else [])
    if refusal:
        return
    hardware.arm()
    for _ in range(20):
        rig.sleep_until_ns(rig.now_ns() + 10_000_000)
        sensors = hardware.exchange((0.0, 0.0))
    assert (sensors.ready, sensors.faults) == (True, ())
