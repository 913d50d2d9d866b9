# SPDX-License-Identifier: MIT
"""The pair of drives as the loop uses it, against nodes of the canopen library and frame by frame."""

import importlib.util
import itertools
import math
import subprocess
import sys
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.cia402.driver import Cia402Drives, MissingLibraryError
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.links.link import Frame

MS = 1_000_000
LEFT, RIGHT = 1, 2
SETTINGS = Cia402Settings(
    host_node_id=0x7E,
    axes={
        "left": Cia402WheelSettings(node_id=LEFT, counts_per_turn=4000, max_torque=5.0, gear_ratio=2.0, direction=-1),
        "right": Cia402WheelSettings(node_id=RIGHT, counts_per_turn=1000, max_torque=2.0, velocity_units_per_turn=60.0),
    },
)
DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x0240, 0x0231, 0x0233, 0x1237, 0x0217, 0x0218
HOST_HEARTBEAT, SYNC = (0x77E, "05"), (0x080, "")


class Bench:
    """A pair on a link in memory with nodes of the library; these know no state machine: statuses are told by hand."""

    def __init__(self, memory: Any, *nodes: int) -> None:
        self.memory = memory
        for node_id in nodes:
            memory.add(node_id)
        self.pair = Cia402Drives(memory, SETTINGS, 0.01, memory.clock, memory.sleep_until_ns)

    def start(self) -> None:
        self.pair.start()
        self.memory.receive()
        self.memory.heard()

    def tell(self, identifier: int, data: str, *, is_extended: bool = False) -> bool:
        """Let a frame arrive now."""
        frame = Frame(identifier, bytes.fromhex(data), self.memory.now_ns, is_extended=is_extended)
        return self.pair.take_frame(frame)

    def tell_status(self, left: int, right: int | None = None, *, nmt: int = 5) -> None:
        """Let everything that drives send in a cycle arrive from both."""
        for node_id, statusword in ((LEFT, left), (RIGHT, left if right is None else right)):
            word = statusword.to_bytes(2, "little").hex()
            assert self.tell(0x180 + node_id, f"{word}000000000000")
            assert self.tell(0x280 + node_id, "00000000")
            assert self.tell(0x700 + node_id, f"{nmt:02x}")

    def cycle(self, *commands: float) -> list[str]:
        """One cycle with these torques; what both drives are told."""
        self.memory.now_ns += 10 * MS
        self.memory.heard()
        self.pair.command(commands or (0.0, 0.0))
        heard = dict(self.memory.heard())
        return [heard[0x200 + LEFT], heard[0x200 + RIGHT]]

    def enable(self) -> None:
        """Take both drives to where they follow."""
        self.start()
        self.tell_status(DISABLED)
        assert self.pair.arming_failures() == []
        self.pair.enable()
        for statusword in (DISABLED, READY, SWITCHED_ON, ENABLED):
            self.tell_status(statusword)
            self.cycle()
        assert self.pair.is_enabled


@pytest.fixture
def bench(memory: Any) -> Bench:
    return Bench(memory, LEFT, RIGHT)


def test_is_a_drive_with_named_and_limited_ports(bench: Bench) -> None:
    drive: Drive = bench.pair
    of_wheels = [f"{s}.{v}" for s in ("left", "right") for v in ("angle", "velocity", "torque")]
    assert list(drive.signals) == [*of_wheels, "supply.voltage"]
    assert list(drive.commands) == ["left.torque", "right.torque"]
    assert drive.limits == (5.0, 2.0)
    assert {key.arbitration_id for key in drive.listens_to} == {
        base + node for base in (0x80, 0x180, 0x280, 0x380, 0x580, 0x700) for node in (LEFT, RIGHT)
    }
    assert not any(key.is_extended for key in drive.listens_to)


def test_missing_library_is_reported_with_its_install_command(memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(MissingLibraryError, match=r"pip install 'segway-ecc\[canopen\]'"):
        Bench(memory)


WITHOUT_LIBRARY = """
import sys
sys.modules["canopen"] = None
from segway_ecc.firmware_io.build import build_hardware
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.node.config import load_robot
settings = load_robot("cart-cia402").hardware
try:
    build_hardware(settings, 0.01, RealClock())
except HardwareError as error:
    print(error)
"""


def test_all_but_these_drives_works_without_the_library() -> None:
    found = subprocess.run([sys.executable, "-c", WITHOUT_LIBRARY], check=True, capture_output=True, text=True)
    assert found.stdout == (
        "hardware of type cia402 needs the canopen library, which is not installed: pip install 'segway-ecc[canopen]'\n"
    )


def test_starting_resets_sets_up_and_starts_both_nodes(bench: Bench) -> None:
    bench.pair.start()
    nmt = [data for identifier, data in bench.memory.heard() if identifier == 0]
    assert nmt == ["8201", "8202", "8001", "8002", "0101", "0102"]
    assert bench.memory.nodes[LEFT].nmt.state == "OPERATIONAL"
    assert bench.memory.nodes[RIGHT].nmt.state == "OPERATIONAL"


def test_a_cycle_is_heartbeat_commands_and_one_sync_in_this_order(bench: Bench) -> None:
    bench.start()
    bench.pair.command((1.0, 1.0))
    assert bench.memory.heard() == [HOST_HEARTBEAT, (0x201, "00000000"), (0x202, "00000000"), SYNC]


def test_our_commands_are_what_the_librarys_pdos_make(bench: Bench) -> None:
    bench.enable()
    data = bench.cycle(1.5, -1.0)
    for node_id, share, sent in ((LEFT, -0.6, data[0]), (RIGHT, -0.8, data[1])):
        node = bench.memory.nodes[node_id]
        node.rpdo.read()
        pdo = node.rpdo[1]
        assert node.rpdo[1].cob_id == 0x200 + node_id
        # Rated 1.25 N m: left 1.5 N m at the wheel is -0.75 N m at the motor, right -1 N m is -1 N m.
        pdo[0x6040].raw, pdo[0x6071].raw = 0x0F, round(share * 1000)
        assert sent == bytes(pdo.data).hex()


def test_the_librarys_pdos_are_read(bench: Bench) -> None:
    bench.start()
    for node_id, counts, velocity, permille, millivolts in (
        (LEFT, -6000, 8000, 100, 24_500),
        (RIGHT, 250, -90, -200, 24_400),
    ):
        node = bench.memory.nodes[node_id]
        node.tpdo.read()
        status, speed, supply = node.tpdo[1], node.tpdo[2], node.tpdo[3]
        status[0x6041].raw, status[0x6064].raw, status[0x6077].raw = DISABLED, counts, permille
        speed[0x606C].raw = velocity
        supply[0x6079].raw = millivolts
        status.transmit()
        speed.transmit()
        supply.transmit()
    frames = bench.memory.receive()
    assert [(frame.arbitration_id, len(frame.data)) for frame in frames] == [
        (0x181, 8),
        (0x281, 4),
        (0x381, 4),
        (0x182, 8),
        (0x282, 4),
        (0x382, 4),
    ]
    assert all(bench.pair.take_frame(frame) for frame in frames)

    readings = bench.pair.read()
    turn = 2.0 * math.pi
    assert readings.values == pytest.approx((0.75 * turn, -turn, -0.25, 0.25 * turn, -1.5 * turn, -0.25, 24.5))
    assert readings.ages == (0.0,) * 7
    assert readings.valid == (True,) * 7
    assert bench.pair.health["right.bus_voltage_v"] == "24.400"


def test_the_supply_is_the_left_drives_and_valid_for_a_second(bench: Bench) -> None:
    bench.start()
    assert bench.tell(0x380 + LEFT, "b45f0000")
    bench.tell(0x380 + RIGHT, "00000000")
    bench.memory.now_ns += 1_000 * MS
    readings = bench.pair.read()
    assert (readings.values[6], readings.ages[6]) == pytest.approx((24.5, 1.0))
    assert readings.valid == (*(False,) * 6, True)
    bench.memory.now_ns += 1
    assert bench.pair.read().valid == (False,) * 7
    assert bench.pair.health["left.bus_voltage_v"] == "not reported"


def test_unreported_supply_is_no_fault_and_no_arming_failure(bench: Bench) -> None:
    bench.enable()
    assert bench.pair.read().valid[6] is False
    assert bench.pair.faults() == ()
    assert bench.pair.arming_failures() == []


def test_before_anything_arrived_values_are_zero_infinitely_old_and_invalid(bench: Bench) -> None:
    readings = bench.pair.read()
    assert readings.values == (0.0,) * 7
    assert readings.ages == (math.inf,) * 7
    assert readings.valid == (False,) * 7


def test_values_are_stale_after_three_cycles(bench: Bench) -> None:
    bench.start()
    bench.tell_status(DISABLED)
    bench.memory.now_ns += 30 * MS
    bench.tell(0x180 + RIGHT, "4002000000000000")
    assert bench.pair.read().valid[:6] == (True,) * 6
    bench.memory.now_ns += 1
    # The right drive has just told its position, and the rest of it may be missing for a while longer.
    assert bench.pair.read().valid[:6] == (False, False, False, True, True, True)


def test_the_position_goes_on_over_its_wrap(bench: Bench) -> None:
    bench.start()
    for counts in (2**31 - 500, -(2**31) + 500):
        bench.tell(0x180 + RIGHT, "4002" + counts.to_bytes(4, "little", signed=True).hex() + "0000")
    assert bench.pair.read().values[3] == pytest.approx((2**31 + 500) / 1000 * 2 * math.pi)


def test_enabling_is_one_step_a_cycle_with_zero_torque(bench: Bench) -> None:
    bench.start()
    bench.tell_status(DISABLED)
    bench.pair.enable()
    told = []
    for statusword in (DISABLED, READY, SWITCHED_ON):
        bench.tell_status(statusword)
        told.append(bench.cycle(1.0, 1.0))
        assert not bench.pair.is_enabled
        assert bench.pair.faults() == ()
    assert told == [["06000000"] * 2, ["07000000"] * 2, ["0f000000"] * 2]
    bench.tell_status(ENABLED)
    assert bench.cycle(1.25, 1.25) == ["0f000cfe", "0f00e803"]
    assert bench.pair.is_enabled


def test_each_drive_takes_its_own_steps_and_torque_waits_for_both(bench: Bench) -> None:
    bench.start()
    bench.tell_status(DISABLED)
    bench.pair.enable()
    bench.tell_status(READY, DISABLED)
    assert bench.cycle(1.0, 1.0) == ["07000000", "06000000"]
    bench.tell_status(ENABLED, SWITCHED_ON)
    assert bench.cycle(1.0, 1.0) == ["0f000000", "0f000000"]
    assert not bench.pair.is_enabled


def test_a_latched_fault_is_reset_by_a_rising_edge_on_the_way(bench: Bench) -> None:
    bench.start()
    bench.tell_status(FAULT)
    assert bench.pair.arming_failures() == []
    assert bench.cycle() == ["00000000"] * 2
    bench.pair.enable()
    told = [bench.cycle()[0] for _ in range(3)]
    assert told == ["80000000", "00000000", "80000000"]
    bench.tell_status(DISABLED)
    assert bench.cycle()[0] == "06000000"
    assert bench.pair.faults() == ()


def test_a_drive_that_is_found_on_is_switched_off_first(bench: Bench) -> None:
    bench.start()
    bench.tell_status(ENABLED)
    bench.pair.enable()
    assert bench.cycle(1.0, 1.0) == ["00000000"] * 2
    assert not bench.pair.is_enabled
    bench.tell_status(DISABLED)
    assert bench.cycle(1.0, 1.0) == ["06000000"] * 2


def test_drives_that_do_not_enable_are_a_fault_after_half_a_second(bench: Bench) -> None:
    bench.start()
    bench.pair.enable()
    for _ in range(50):
        bench.tell_status(READY, SWITCHED_ON)
        bench.cycle()
    bench.tell_status(READY, SWITCHED_ON)
    assert bench.pair.faults() == ()
    bench.cycle()
    bench.tell_status(READY, SWITCHED_ON)
    assert bench.pair.faults() == (
        "the drives do not enable their motors: the left drive is ready to switch on, the right drive is switched on",
    )


def test_torque_is_limited_and_what_is_not_finite_is_zero(bench: Bench) -> None:
    bench.enable()
    assert bench.cycle(100.0, -100.0) == ["0f0030f8", "0f00c0f9"]
    assert bench.cycle(math.nan, math.inf) == ["0f000000"] * 2


def test_disabling_takes_the_voltage_at_once_and_every_time(bench: Bench) -> None:
    bench.enable()
    for _ in range(2):
        bench.memory.heard()
        bench.pair.disable()
        assert bench.memory.heard() == [(0x201, "00000000"), (0x202, "00000000")]
    assert not bench.pair.is_enabled
    assert bench.cycle(1.0, 1.0) == ["00000000"] * 2


def test_the_heartbeat_leaves_only_with_a_command(bench: Bench) -> None:
    bench.enable()
    bench.memory.heard()
    bench.memory.now_ns += 1_000 * MS
    bench.pair.read()
    bench.pair.faults()
    bench.pair.disable()
    assert HOST_HEARTBEAT not in bench.memory.heard()


@pytest.mark.parametrize("statusword", [FAULT, 0x021F, DISABLED, QUICK_STOP, 0x0001])
def test_a_drive_that_leaves_its_motor_is_a_fault_and_neither_turns(bench: Bench, statusword: int) -> None:
    bench.enable()
    bench.tell_status(ENABLED, statusword)
    assert bench.cycle(1.0, 1.0) == ["0f000000", "00000000"]
    bench.tell_status(ENABLED, statusword)
    (fault,) = bench.pair.faults()
    assert fault.startswith("the right drive left its motor: ")
    bench.pair.disable()
    assert bench.pair.faults() == ()


def test_an_emergency_is_a_fault_until_disabled(bench: Bench) -> None:
    bench.start()
    bench.tell(0x080 + LEFT, "3081110000000000")
    assert bench.pair.faults() == ()
    bench.enable()
    assert bench.pair.faults() == ()
    bench.tell(0x080 + LEFT, "1023030000000000")
    bench.tell(0x080 + LEFT, "0000000000000000")
    assert bench.pair.faults() == ("the left drive reports EMCY 0x2310 (current), its state is operation enabled",)
    bench.pair.disable()
    assert bench.pair.faults() == ()
    assert bench.pair.health["left.emergency"] == "EMCY 0x2310 (current)"


@pytest.mark.parametrize(("nmt", "name"), [(0x7F, "pre-operational"), (0x04, "stopped")])
def test_a_node_that_is_no_longer_operational_is_a_fault(bench: Bench, nmt: int, name: str) -> None:
    bench.enable()
    bench.tell(0x700 + RIGHT, f"{nmt:02x}")
    assert bench.pair.faults()[0] == f"the right drive has left the operational state: {name}"
    assert bench.cycle(1.0, 1.0) == ["0f000000", "00000000"]


def test_such_a_node_is_started_again_while_disarmed_once_for_each_heartbeat(bench: Bench) -> None:
    bench.start()
    bench.tell(0x700 + RIGHT, "7f")
    assert "is not operational: pre-operational" in bench.pair.arming_failures()[1]
    bench.pair.command((0.0, 0.0))
    assert bench.memory.heard()[4:] == [(0x000, "0102")]
    bench.pair.command((0.0, 0.0))
    assert len(bench.memory.heard()) == 4


@pytest.mark.parametrize(
    ("silent", "after_ms", "name"), [(0x180, 50, "status"), (0x280, 50, "velocity"), (0x700, 100, "heartbeat")]
)
def test_one_message_that_is_missing_is_a_fault_after_five_periods(
    bench: Bench, silent: int, after_ms: int, name: str
) -> None:
    bench.enable()
    frames = {0x180: "3712000000000000", 0x280: "00000000", 0x700: "05"}
    bench.memory.now_ns -= 10 * MS
    for moment, (service, data), node in itertools.product(range(after_ms), frames.items(), (LEFT, RIGHT)):
        bench.memory.now_ns += MS * (service == 0x180 and node == LEFT)
        if moment and (service, node) != (silent, RIGHT):
            bench.tell(service + node, data)
    assert bench.pair.faults() == ()
    bench.memory.now_ns += 1
    assert bench.pair.faults() == (f"the {name} of the right drive is too old: {after_ms} ms",)


def test_restart_while_armed_is_a_fault_and_is_set_up_again_only_once_disarmed(bench: Bench) -> None:
    bench.enable()
    bench.tell(0x700 + LEFT, "00")
    assert bench.pair.faults()[0] == "the left drive has restarted"
    bench.cycle(1.0, 1.0)
    bench.memory.heard()
    bench.pair.command((1.0, 1.0))
    assert 0x601 not in dict(bench.memory.heard())
    bench.pair.disable()
    bench.pair.command((0.0, 0.0))
    assert (0x601, "4000100000000000") in bench.memory.heard()
    assert "restarted and is being set up again" in bench.pair.arming_failures()[0]


def test_restarted_drive_gets_no_torque_even_if_it_reports_operation_enabled(bench: Bench) -> None:
    bench.enable()
    bench.tell(0x700 + LEFT, "00")
    bench.tell_status(ENABLED)
    assert bench.cycle(1.0, 1.0) == ["00000000", "0f000000"]


def test_the_rated_torque_goes_with_the_torque_at_the_motor_not_at_the_wheel(memory: Any) -> None:
    bench = Bench(memory, LEFT, RIGHT)
    for node in memory.nodes.values():
        # 2.5 N m at the left motor is 31 times this, 5 N m at its wheel would be 62 times.
        node.sdo[0x6076].raw = 80
    bench.start()
    assert (bench.pair.health["left.set_up"], bench.pair.health["right.set_up"]) == ("yes", "yes")


def test_a_drive_that_restarted_is_set_up_again_a_request_a_cycle(bench: Bench) -> None:
    bench.start()
    before = dict(bench.memory.nodes[LEFT].data_store)
    bench.tell_status(DISABLED)
    bench.tell(0x180 + LEFT, "4002e80300000000")
    angle = bench.pair.read().values[0]
    bench.memory.nodes[LEFT].data_store.clear()
    bench.tell(0x700 + LEFT, "00")
    requests = 0
    while bench.pair.health["left.set_up"] != "yes":
        bench.cycle()
        for frame in bench.memory.receive():
            bench.pair.take_frame(frame)
        requests += 1
        assert requests < 100
    assert bench.memory.nodes[LEFT].data_store == before

    bench.tell(0x700 + LEFT, "7f")
    bench.memory.heard()
    bench.pair.command((0.0, 0.0))
    assert (0x000, "0101") in bench.memory.heard()
    bench.tell_status(DISABLED)
    assert bench.pair.arming_failures() == []
    assert bench.pair.read().values[0] == pytest.approx(angle)
    assert angle == pytest.approx(-1000 / 4000 * 2 * math.pi / 2)


def test_another_drive_in_its_place_is_not_armed(bench: Bench) -> None:
    bench.start()
    bench.tell(0x700 + LEFT, "00")
    bench.cycle()
    bench.memory.receive()
    bench.tell(0x580 + LEFT, "4300100091010200")
    for _ in range(31):
        bench.cycle()
        bench.memory.receive()
    (reason, _) = bench.pair.arming_failures()
    assert "restarted and object 0x1000:00 is not answered as it was; is it the same drive?" in reason
    assert bench.pair.health["left.set_up"] == "object 0x1000:00 is not answered as it was"


def test_drives_that_are_not_there_refuse_arming_with_what_to_do(memory: Any) -> None:
    bench = Bench(memory, LEFT)
    before_ns = memory.now_ns
    bench.start()
    assert memory.now_ns - before_ns == pytest.approx(5_400 * MS, rel=0.2)
    left, right = bench.pair.arming_failures()
    assert left == "the left drive (node 1) does not answer on memory; is it powered and on this bus?"
    assert right == (
        "the right drive (node 2) on memory is not set up: its object 0x1000:00 cannot be read: no answer; "
        "fix that, then start the node again"
    )
    assert bench.cycle(1.0, 1.0) == ["00000000"] * 2


def test_a_boot_up_of_a_drive_that_was_never_set_up_does_not_arm_it(memory: Any) -> None:
    bench = Bench(memory, LEFT)
    bench.start()
    bench.tell(0x700 + RIGHT, "00")
    bench.tell(0x700 + RIGHT, "7f")
    bench.memory.heard()
    bench.pair.command((0.0, 0.0))
    assert [identifier for identifier, _ in bench.memory.heard()] == [0x77E, 0x201, 0x202, 0x080]
    assert "is not set up" in bench.pair.arming_failures()[1]


def test_a_link_that_is_gone_at_the_start_refuses_arming(bench: Bench) -> None:
    bench.memory.is_gone = True
    bench.pair.start()
    assert all("memory is gone" in reason for reason in bench.pair.arming_failures())


def test_a_drive_that_restarts_while_it_is_set_up_is_set_up_anew(bench: Bench) -> None:
    boots = iter([True, False])

    def restart(index: int, **_: Any) -> None:
        if index == 0x6060 and next(boots, False):
            bench.memory.arrived.append(Frame(0x701, b"\0", bench.memory.now_ns))

    bench.memory.nodes[LEFT].add_write_callback(restart)
    bench.start()
    assert bench.pair.health["left.set_up"] == "yes"
    assert bench.memory.nodes[LEFT].nmt.state == "OPERATIONAL"


def test_drive_that_keeps_restarting_is_reported(bench: Bench) -> None:
    def restart(index: int, **_: Any) -> None:
        if index == 0x6060:
            bench.memory.arrived.append(Frame(0x701, b"\0", bench.memory.now_ns))

    bench.memory.nodes[LEFT].add_write_callback(restart)
    bench.start()
    assert "is not set up: it restarts again and again" in bench.pair.arming_failures()[0]


def test_drive_that_restarts_during_set_up_is_set_up_again_by_the_loop(bench: Bench) -> None:
    def restart(index: int, **_: Any) -> None:
        if index == 0x6060:
            bench.memory.arrived.append(Frame(0x701, b"\0", bench.memory.now_ns))

    bench.memory.nodes[RIGHT].add_write_callback(restart)
    bench.start()
    assert "left drive (node 1) restarted and is being set up again" in bench.pair.arming_failures()[0]


def test_damaged_frames_are_counted_and_make_nothing_younger(bench: Bench) -> None:
    bench.start()
    assert not bench.tell(0x180 + LEFT, "40020000000000")
    assert not bench.tell(0x280 + LEFT, "0000000000")
    assert not bench.tell(0x700 + LEFT, "55")
    assert not bench.tell(0x080 + LEFT, "")
    assert not bench.tell(0x580 + LEFT, "6017100000000000")
    assert bench.pair.read().valid == (False,) * 7
    health = bench.pair.health
    assert (health["left.refused.length"], health["left.refused.range"]) == ("3", "1")
    assert not any(name.startswith("right.refused") for name in health)


def test_health_has_the_state_of_the_drives(bench: Bench) -> None:
    assert bench.pair.health["left.set_up"] == "it has not been set up"
    assert bench.pair.health["left.rated_torque_nm"] == "unknown"
    bench.enable()
    health = bench.pair.health
    assert health["right.state"] == "operation enabled"
    assert health["right.nmt"] == "operational"
    assert health["right.emergency"] == "none"
    assert health["right.rated_torque_nm"] == "1.25"


def test_frames_of_others_change_nothing(bench: Bench) -> None:
    bench.enable()
    before = (bench.pair.read(), bench.pair.faults(), dict(bench.pair.health))
    listed = {key.arbitration_id for key in bench.pair.listens_to}
    for identifier, length in itertools.product(range(2048), range(9)):
        frame = Frame(identifier, bytes(length), bench.memory.now_ns)
        assert identifier in listed or not bench.pair.take_frame(frame)
        assert not bench.pair.take_frame(replace(frame, is_extended=True))
    assert (bench.pair.read(), bench.pair.faults(), dict(bench.pair.health)) == before


@settings(max_examples=500)
@given(st.lists(st.tuples(st.sampled_from([0x080, 0x180, 0x280, 0x580, 0x700]), st.binary(max_size=8)), max_size=6))
def test_whatever_the_drives_send_values_stay_finite_and_nothing_raises(frames: list[tuple[int, bytes]]) -> None:
    now_ns = 0
    link: Any = _Nowhere()
    pair = Cia402Drives(link, SETTINGS, 0.01, lambda: now_ns, lambda _deadline_ns: None)
    pair.enable()
    for service, data in frames:
        now_ns += MS
        pair.take_frame(Frame(service + LEFT, data, now_ns))
        pair.command((1.0, 1.0))
        assert all(map(math.isfinite, pair.read().values))
        assert not pair.is_enabled
        pair.faults()
        pair.arming_failures()


class _Nowhere:
    description = "nowhere"

    def send(self, frame: Frame) -> bool:
        assert frame.arbitration_id not in (0x201, 0x202) or frame.data[2:] == b"\0\0"
        return True


def test_a_link_that_takes_nothing_does_not_disturb_the_loop(bench: Bench) -> None:
    bench.enable()
    bench.memory.is_full = True
    bench.pair.command((1.0, 1.0))
    bench.pair.disable()


@pytest.mark.parametrize(
    ("statusword", "is_off"),
    [
        (0x0200, True),  # not ready to switch on
        (DISABLED, True),
        (READY, True),
        (SWITCHED_ON, True),
        (FAULT, True),
        (ENABLED, False),
        (QUICK_STOP, False),
        (0x021F, False),  # fault reaction active
        (0x0001, False),  # none of the profile's
    ],
)
def test_disable_feedback_needs_both_statuswords_after_the_command(
    bench: Bench, statusword: int, *, is_off: bool
) -> None:
    bench.enable()
    assert not bench.pair.is_off
    bench.pair.disable()
    bench.tell_status(DISABLED)
    assert not bench.pair.is_off, "that had arrived by then"
    for both in ((DISABLED, statusword), (statusword, DISABLED)):
        bench.memory.now_ns += MS
        bench.tell_status(*both)
        assert bench.pair.is_off is is_off


def test_they_are_off_only_while_both_statuswords_are_fresh_whatever_else_they_send(bench: Bench) -> None:
    bench.start()
    said = [bench.pair.is_off]
    bench.tell_status(DISABLED)
    said.append(bench.pair.is_off)
    bench.pair.disable()
    said.append(bench.pair.is_off)  # they were off before they were told so again
    for _ in range(20):
        bench.memory.now_ns += 10 * MS
        bench.tell(0x180 + LEFT, "4002000000000000")
        bench.tell(0x280 + RIGHT, "00000000")
    said.append(bench.pair.is_off)
    assert said == [False, True, True, False]


def test_restart_clears_disable_feedback(bench: Bench) -> None:
    bench.start()
    bench.tell_status(DISABLED)
    bench.tell(0x700 + LEFT, "00")
    assert not bench.pair.is_off
