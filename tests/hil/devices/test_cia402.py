# SPDX-License-Identifier: MIT
"""The simulated drives, frame by frame."""

import itertools
import math
from typing import Any

import pytest

from segway_ecc.firmware_io.drives.cia402.frames import DriveState
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.cia402 import RATED_TORQUE_MNM, TICK_NS, DriveKind, SimulatedCia402
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from tests.hil.devices.cia402_faults import latch_fault

LEFT, RIGHT = 1, 2
MS = 1_000_000
SETTINGS = Cia402Settings(
    axes={
        "left": Cia402WheelSettings(node_id=LEFT, counts_per_turn=4000, max_torque=5.0, gear_ratio=2.0, direction=-1),
        "right": Cia402WheelSettings(node_id=RIGHT, counts_per_turn=1000, max_torque=2.0, velocity_units_per_turn=60.0),
    },
)
WATCHDOG = "2316100132007f00"
HEARTBEAT = (0x77F, "05")
TURN = 2.0 * math.pi


class Bench:
    """Both drives on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self, kind: DriveKind | None = None) -> None:
        self.now_ns = 0
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self.host = bus.attach("host")
        self.link = bus.attach("drives")
        self.drives = SimulatedCia402(self.link, SETTINGS, kind=kind or DriveKind())
        self.outputs = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}
        self.torques: tuple[float, ...] = ()

    def send(self, *frames: tuple[int, str]) -> None:
        for identifier, data in frames:
            self.host.send(Frame(identifier, bytes.fromhex(data)))
        self.now_ns += 10_000

    def tick(self, *frames: tuple[int, str], times: int = 1) -> list[tuple[int, str]]:
        """Send frames, let the drives tick, and return what they sent."""
        self.send(*frames)
        for _ in range(times):
            self.now_ns += TICK_NS
            self.torques = tuple(self.drives.obey(self.link.receive(), self.now_ns, self.outputs))
            self.drives.send_telemetry(self.now_ns, self.outputs)
        self.now_ns += 10_000
        return [(frame.arbitration_id, frame.data.hex()) for frame in self.host.receive()]

    def ask(self, *requests: str, node: int = LEFT) -> list[str]:
        """The answers to SDO requests."""
        heard = self.tick(*((0x600 + node, request) for request in requests))
        return [data for identifier, data in heard if identifier == 0x580 + node]

    def map(self) -> None:
        """Set both drives up as the host does, by literal requests."""
        for node in (LEFT, RIGHT):
            cob = f"{node:02x}020000", f"{0x80 + node:02x}010000", f"{0x80 + node:02x}020000"
            requests = [
                WATCHDOG, "2b07600002000000", "2f6060000a000000",
                "2300160110004060", "2300160210007160", "2f00160002000000", f"23001401{cob[0]}",
                "23001a0110004160", "23001a0220006460", "23001a0310007760", "2f001a0003000000",
                "2f00180201000000", f"23001801{cob[1]}",
                "23011a0120006c60", "2f011a0001000000", "2f01180201000000", f"23011801{cob[2]}",
            ]  # fmt: skip
            assert all(answer.startswith("60") for answer in self.ask(*requests, node=node))

    def command(self, controlword: int, permille: int = 0) -> list[tuple[int, str]]:
        """One cycle of the host."""
        data = controlword.to_bytes(2, "little") + permille.to_bytes(2, "little", signed=True)
        return self.tick(HEARTBEAT, (0x201, data.hex()), (0x202, data.hex()), (0x080, ""))

    def enable(self) -> None:
        """Bring both drives to operation enabled."""
        self.tick()
        self.map()
        self.tick((0x000, "0100"))
        for controlword in (0x06, 0x07, 0x0F):
            self.command(controlword)
        assert self.states() == [DriveState.OPERATION_ENABLED] * 2

    def states(self) -> list[DriveState]:
        return [self.drives.axes["left"].state, self.drives.axes["right"].state]

    def statusword(self) -> str:
        return dict(self.command_unchanged())[0x181][:4]

    def command_unchanged(self) -> list[tuple[int, str]]:
        return self.tick(HEARTBEAT, (0x080, ""))


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_is_a_device_of_two_torques(bench: Bench) -> None:
    device: Device = bench.drives
    assert list(device.inputs) == ["left.torque", "right.torque"]
    assert TICK_NS == MS


def test_boots_up_once_and_then_is_silent(bench: Bench) -> None:
    assert bench.tick() == [(0x701, "00"), (0x702, "00")]
    assert bench.tick(times=100) == []


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("4000100000000000", "4300100092010200"),
        ("4076600000000000", "43766000dc050000"),
        ("4061600000000000", "4f61600000000000"),
        ("2b17100014000000", "6017100000000000"),
        ("2b17100014000000 4017100000000000", "4b17100014000000"),
        ("2217100014000000", "6017100000000000"),
        ("4000200000000000", "8000200000000206"),
        ("4000140900000000", "8000140911000906"),
        ("2300100000000000", "8000100002000106"),
        ("2f17100014000000", "8017100010000706"),
        ("2317100014000000", "8017100010000706"),
        ("2117100004000000", "8017100001000405"),
        ("6017100000000000", "8017100001000405"),
        ("2300160110004060 2300160110004160", "6000160100000000"),
        ("2300160110007660", "8000160141000406"),
        ("2300160120004060", "8000160141000406"),
        ("2300160110000020", "8000160141000406"),
        ("2f00160001000000", "8000160042000406"),
        ("2f00160009000000", "8000160042000406"),
        ("23001a0120006460 23001a0220006c60 23001a0310004160 2f001a0003000000", "80001a0042000406"),
        ("2300160110004060 2f00160001000000 2300160110007160", "8000160122000008"),
        ("2300140101020000 2300160110004060", "8000160122000008"),
    ],
)
def test_the_sdo_server_answers_as_in_the_standard(bench: Bench, request_: str, answer: str) -> None:
    bench.tick()
    assert bench.ask(*request_.split())[-1] == answer


def test_an_aborted_transfer_and_a_frame_of_another_length_are_not_answered(bench: Bench) -> None:
    bench.tick()
    assert bench.ask("8000100000000405") == []
    assert bench.ask("400010000000") == []
    assert bench.drives.refused_frames == 1


def test_heartbeats_come_at_the_time_that_was_written_with_the_state(bench: Bench) -> None:
    bench.tick()
    bench.ask("2b17100014000000")
    assert bench.tick(times=100) == [(0x701, "7f")] * 5
    assert bench.tick((0x000, "0101"), times=20) == [(0x701, "05")]
    assert bench.tick((0x000, "0201"), times=20) == [(0x701, "04")]
    assert bench.tick((0x000, "8001"), times=20) == [(0x701, "7f")]
    assert bench.tick((0x000, "0102"), times=20) == [(0x701, "7f")]
    assert bench.tick((0x000, "0100"), times=20) == [(0x701, "05")]
    assert bench.tick((0x000, "05"), (0x000, "9901"), times=20) == [(0x701, "05")]


def test_a_stopped_node_answers_no_sdo(bench: Bench) -> None:
    bench.tick()
    bench.tick((0x000, "0201"))
    assert bench.ask("4000100000000000") == []


@pytest.mark.parametrize(("command", "mode_after"), [("82", "0a"), ("81", "00")])
def test_a_reset_forgets_the_set_up_and_boots(bench: Bench, command: str, mode_after: str) -> None:
    bench.enable()
    assert (0x701, "00") in bench.tick((0x000, f"{command}01"))
    assert bench.states()[0] is DriveState.SWITCH_ON_DISABLED
    bench.ask()
    assert bench.ask("4016100100000000") == ["4316100100000000"]
    assert bench.ask("4060600000000000") == [f"4f606000{mode_after}000000"]
    assert 0x181 not in dict(bench.command(0x00))


def test_pdos_pass_only_while_operational_and_on_sync(bench: Bench) -> None:
    bench.tick()
    bench.map()
    assert bench.command(0x06) == []
    bench.tick((0x000, "0100"))
    assert bench.tick(HEARTBEAT, (0x201, "06000000")) == []
    heard = bench.tick((0x080, ""))
    assert [identifier for identifier, _ in heard] == [0x181, 0x182, 0x281, 0x282]
    assert bench.tick() == []
    assert heard[0] == (0x181, "3102000000000000")


def test_a_synchronous_command_waits_for_sync(bench: Bench) -> None:
    bench.enable()
    bench.ask("2f00140201000000")
    bench.tick(HEARTBEAT, (0x201, "0f00e803"))
    assert bench.torques[0] == 0.0
    bench.tick(HEARTBEAT, (0x080, ""))
    assert bench.torques[0] == pytest.approx(-3.0)


def test_a_status_may_come_at_every_third_sync(bench: Bench) -> None:
    bench.enable()
    bench.ask("2f00180203000000")
    heard = [0x181 in dict(bench.command(0x0F)) for _ in range(6)]
    assert heard == [False, False, True] * 2


def test_positions_and_velocities_are_in_the_units_of_the_settings(bench: Bench) -> None:
    bench.enable()
    bench.outputs |= {"left.angle": TURN, "left.velocity": -TURN, "right.angle": 0.5 * TURN, "right.velocity": 2 * TURN}
    heard = dict(bench.command(0x0F))
    assert int.from_bytes(bytes.fromhex(heard[0x181])[2:6], "little", signed=True) == -8000
    assert int.from_bytes(bytes.fromhex(heard[0x281]), "little", signed=True) == 8000
    assert int.from_bytes(bytes.fromhex(heard[0x182])[2:6], "little", signed=True) == 500
    assert int.from_bytes(bytes.fromhex(heard[0x282]), "little", signed=True) == 120


def test_encoders_report_whole_counts_and_wrap(bench: Bench) -> None:
    bench.enable()
    bench.outputs["right.angle"] = 10.9 / 1000 * TURN
    assert dict(bench.command(0x0F))[0x182][4:12] == "0a000000"
    bench.outputs["right.angle"] = -0.1 / 1000 * TURN
    assert dict(bench.command(0x0F))[0x182][4:12] == "ffffffff"
    bench.outputs["right.angle"] = (2**31 + 0.5) / 1000 * TURN
    assert dict(bench.command(0x0F))[0x182][4:12] == "00000080"


def test_torque_is_in_permille_of_rated_and_saturates(bench: Bench) -> None:
    bench.enable()
    bench.command(0x0F, 500)
    assert bench.torques == pytest.approx((-2 * 0.75, 0.75))
    assert dict(bench.command(0x0F, 500))[0x181][12:] == "f401"
    bench.command(0x0F, 3_500)
    assert bench.torques == pytest.approx((-9.0, 4.5))
    bench.command(0x0F, -3_500)
    assert bench.torques == pytest.approx((9.0, -4.5))
    assert RATED_TORQUE_MNM == 1_500


def test_there_is_torque_in_operation_and_torque_mode_only(bench: Bench) -> None:
    bench.enable()
    bench.ask("2f60600000000000")
    bench.command(0x0F, 500)
    assert bench.torques[0] == 0.0
    assert bench.torques[1] == pytest.approx(0.75)
    bench.command(0x07, 500)
    assert bench.torques[1] == 0.0


@pytest.mark.parametrize(
    ("path", "state", "statusword"),
    [
        ([], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x07], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x0F], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x06], DriveState.READY, "3102"),
        ([0x06, 0x07], DriveState.SWITCHED_ON, "3302"),
        ([0x06, 0x07, 0x06], DriveState.READY, "3102"),
        ([0x06, 0x07, 0x00], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x06, 0x02], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x06, 0x07, 0x0F], DriveState.OPERATION_ENABLED, "3712"),
        ([0x06, 0x07, 0x0F, 0x07], DriveState.SWITCHED_ON, "3302"),
        ([0x06, 0x07, 0x0F, 0x06], DriveState.READY, "3102"),
        ([0x06, 0x07, 0x0F, 0x00], DriveState.SWITCH_ON_DISABLED, "4002"),
        ([0x06, 0x07, 0x0F, 0x02], DriveState.SWITCH_ON_DISABLED, "4002"),
    ],
)
def test_the_state_machine_is_the_profiles(bench: Bench, path: list[int], state: DriveState, statusword: str) -> None:
    bench.tick()
    bench.map()
    bench.ask("2b5a600000000000")
    bench.tick((0x000, "0100"))
    for controlword in path:
        bench.command(controlword)
    assert bench.drives.axes["left"].state is state
    assert bench.statusword() == statusword


def test_a_quick_stop_that_stays_is_left_by_disabling_the_voltage_or_enabling(bench: Bench) -> None:
    bench.enable()
    bench.ask("2b5a600005000000")
    bench.command(0x02)
    assert bench.states()[0] is DriveState.QUICK_STOP_ACTIVE
    assert bench.statusword() == "1702"
    bench.command(0x0F)
    assert bench.states()[0] is DriveState.OPERATION_ENABLED
    bench.command(0x02)
    bench.command(0x00)
    assert bench.states()[0] is DriveState.SWITCH_ON_DISABLED


def test_a_fault_is_reported_latched_and_reset_by_a_rising_edge(bench: Bench) -> None:
    bench.enable()
    latch_fault(bench.drives.axes["left"])
    assert bench.states()[0] is DriveState.FAULT_REACTION_ACTIVE
    assert (0x081, "1023030000000000") in bench.command(0x0F, 500)
    assert bench.torques[0] == 0.0
    assert bench.statusword() == "1802"
    for controlword in (0x0F, 0x00, 0x06):
        bench.command(controlword)
        assert bench.states()[0] is DriveState.FAULT
    assert (0x081, "0000000000000000") in bench.command(0x80)
    assert bench.states()[0] is DriveState.SWITCH_ON_DISABLED
    latch_fault(bench.drives.axes["left"])
    bench.command(0x80)
    bench.command(0x80)
    assert bench.states()[0] is DriveState.FAULT


@pytest.mark.parametrize(
    ("option", "state"),
    [
        (0, DriveState.OPERATION_ENABLED),
        (1, DriveState.FAULT),
        (2, DriveState.SWITCH_ON_DISABLED),
        (3, DriveState.SWITCH_ON_DISABLED),
    ],
)
def test_the_watchdog_acts_by_object_6007_once_the_heartbeat_has_stopped(
    bench: Bench, option: int, state: DriveState
) -> None:
    bench.enable()
    bench.ask("2b17100014000000", f"2b0760000{option}000000")
    bench.command(0x0F, 500)
    heard = bench.tick(times=49)
    assert bench.torques[0] == pytest.approx(-1.5)
    assert not any(identifier == 0x081 for identifier, _ in heard)
    heard = bench.tick(times=2)
    assert (0x081, "3081110000000000") in heard
    assert bench.drives.axes["left"].state is state
    assert (bench.torques[0] == 0.0) == (option != 0)
    assert (0x701, "7f") in bench.tick(times=20)


def test_the_watchdog_begins_with_the_first_heartbeat_and_reports_its_end(bench: Bench) -> None:
    bench.tick()
    bench.ask(WATCHDOG)
    assert bench.tick(times=200) == []
    assert bench.tick(HEARTBEAT, times=100) == [(0x081, "3081110000000000")]
    assert bench.tick(HEARTBEAT) == [(0x081, "0000000000000000")]
    assert bench.tick(HEARTBEAT) == []


def test_with_1029_set_to_1_the_node_stays_operational(bench: Bench) -> None:
    bench.enable()
    bench.ask("2f29100101000000", "2b17100014000000")
    bench.tick(times=60)
    assert (0x701, "05") in bench.tick(times=20)


def test_other_frames_do_not_feed_the_watchdog(bench: Bench) -> None:
    bench.enable()
    for _ in range(60):
        bench.tick((0x201, "0f00f401"), (0x080, ""), (0x77E, "05"), (0x77F, "33"))
    assert bench.states()[0] is DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize("command", ["02", "81", "82"])
def test_a_stop_or_reset_takes_the_torque(bench: Bench, command: str) -> None:
    bench.enable()
    bench.command(0x0F, 500)
    bench.tick((0x000, f"{command}01"))
    assert bench.torques[0] == 0.0
    assert bench.torques[1] == pytest.approx(0.75)


def test_a_drive_without_supply_is_silent_and_comes_back_forgetful(bench: Bench) -> None:
    bench.enable()
    bench.outputs["left.angle"] = 3.0
    bench.command(0x0F, 500)
    bench.drives.axes["left"].switch_off()
    assert all(identifier not in (0x181, 0x281, 0x701) for identifier, _ in bench.command(0x0F, 500))
    latch_fault(bench.drives.axes["left"])
    assert bench.torques[0] == 0.0
    bench.drives.axes["left"].switch_on()
    assert (0x701, "00") in bench.tick()
    assert bench.ask("4064600000000000", "4016100100000000") == ["4364600000000000", "4316100100000000"]
    assert bench.states()[0] is DriveState.SWITCH_ON_DISABLED


def test_frames_of_others_change_nothing(bench: Bench) -> None:
    bench.enable()
    bench.command(0x0F, 500)

    def snapshot() -> tuple[Any, ...]:
        def of(drive: Any) -> tuple[Any, ...]:
            objects = {key: entry.value for key, entry in drive.slave.objects._objects.items()}
            return drive.state, drive.torque, drive.slave.nmt, objects

        return of(bench.drives.axes["left"]), of(bench.drives.axes["right"]), bench.drives.refused_frames

    listed = {0x000, 0x080, 0x201, 0x202, 0x601, 0x602, 0x77F}
    before = snapshot()
    frames = [
        Frame(identifier, bytes(length), is_extended=extended)
        for identifier, length, extended in itertools.product(range(2048), range(9), (False, True))
        if extended or identifier not in listed
    ]
    assert tuple(bench.drives.obey(frames, bench.now_ns, bench.outputs)) == bench.torques
    assert snapshot() == before
    bench.drives.send_telemetry(bench.now_ns, bench.outputs)
    assert snapshot() == before


def test_listed_frames_of_a_wrong_length_change_nothing_and_are_counted(bench: Bench) -> None:
    bench.enable()
    bench.command(0x0F, 500)
    lengths = {0x201: 4, 0x601: 8, 0x77F: 1}
    frames = [Frame(i, b"\x01" * n) for i, length in lengths.items() for n in range(9) if n != length]
    torques = tuple(bench.drives.obey(frames, bench.now_ns, bench.outputs))
    assert torques == bench.torques
    assert bench.drives.refused_frames == 8 + 8 + 2 * 8
