# SPDX-License-Identifier: MIT
from collections.abc import Collection, Mapping, Sequence

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.devices import FrameKey, Readings
from segway_ecc.firmware_io.errors import ArmingRefusedError, LinkLostError
from segway_ecc.firmware_io.hardware import Hardware, NoHardware
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState
from segway_ecc.firmware_io.links.redundant_link import RedundantLink

MS = 1_000_000


class Wire:
    """A link that does what it is told."""

    def __init__(self, name: str = "bus") -> None:
        self.counters = LinkCounters()
        self.description = name
        self.state = LinkState.ACTIVE
        self.is_active = False
        self.arrived: list[Frame] = []
        self.sent: list[Frame] = []
        self.journal: list[str] = []
        self.is_gone = False
        self.health: Mapping[str, str] = {"state": "active"}

    def open(self) -> None:
        self.journal.append("open")

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def receive(self) -> list[Frame]:
        if self.is_gone:
            raise LinkLostError("gone")
        frames, self.arrived = self.arrived, []
        return frames

    def close(self) -> None:
        self.journal.append("close")


class Wheel:
    """A drive of one wheel: each cycle it sends its command as one frame, and it enables when it hears so."""

    def __init__(self, link: Link, name: str, identifier: int) -> None:
        self.name = name
        self.signals: Mapping[str, str] = {f"{name}.velocity": "rad/s"}
        self.commands: Mapping[str, str] = {f"{name}.torque": "N m"}
        self.limits: Sequence[float] = (2.0,)
        self.listens_to: Collection[FrameKey] = (FrameKey(identifier),)
        self.periods_s: Mapping[FrameKey, float] = {}
        self.commanded_by: Collection[FrameKey] = (FrameKey(identifier + 0x10),)
        self.is_enabled = False
        self.is_off = True
        self.reasons: list[str] = []
        self.told: list[str] = []
        self.taken: list[Frame] = []
        self.received_ns: int | None = None
        self.age = 0.0
        self.fault: tuple[str, ...] = ()
        self._link = link

    @property
    def health(self) -> Mapping[str, str]:
        return {"taken": str(len(self.taken))}

    def start(self) -> None:
        self.told.append("start")

    def take_frame(self, frame: Frame) -> bool:
        self.taken.append(frame)
        return frame.data != b"bad"

    def read(self) -> Readings:
        return Readings((float(len(self.taken)),), (self.age,), (self.age <= 0.03,))

    def arming_failures(self) -> list[str]:
        return self.reasons

    def enable(self) -> None:
        self.told.append("enable")

    def command(self, commands: Sequence[float]) -> None:
        self._link.send(Frame(0x10, repr(tuple(commands)).encode()))

    def disable(self) -> None:
        self.told.append("disable")
        self.is_enabled = False

    def faults(self) -> tuple[str, ...]:
        return self.fault


class Bench:
    """Two wheels and a link that may be a redundant one."""

    def __init__(self, *, redundant: bool = False) -> None:
        self.now_ns = 1_000 * MS
        self.bus, self.line = Wire("can"), Wire("serial")
        link: Link = RedundantLink(self.bus, self.line, self.now) if redundant else self.bus
        self.left, self.right = Wheel(link, "left", 0x120), Wheel(link, "right", 0x121)
        self.assembly = Assembly(link, [self.left, self.right], now_ns=self.now)

    def now(self) -> int:
        return self.now_ns

    def hear(self, wire: Wire, *, left: bool = True, right: bool = True) -> None:
        """Let telemetry arrive now."""
        wire.arrived += [Frame(0x120, b"", self.now_ns)] * left + [Frame(0x121, b"", self.now_ns)] * right

    def arm(self) -> None:
        self.assembly.arm()
        self.left.is_enabled = self.right.is_enabled = True


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_is_hardware_with_the_ports_of_its_devices_in_order(bench: Bench) -> None:
    hardware: Hardware = bench.assembly
    assert list(hardware.signals.items()) == [("left.velocity", "rad/s"), ("right.velocity", "rad/s")]
    assert list(hardware.commands.items()) == [("left.torque", "N m"), ("right.torque", "N m")]
    assert hardware.limits == (2.0, 2.0)


def test_the_link_is_opened_before_the_devices_start(bench: Bench) -> None:
    bench.assembly.open()
    assert bench.bus.journal == ["open"]
    assert (bench.left.told, bench.right.told) == (["start"], ["start"])


def test_every_frame_goes_to_the_device_that_listens_to_it_and_nobody_elses_to_nobody(bench: Bench) -> None:
    mine = [Frame(0x120, b"1"), Frame(0x121, b"2"), Frame(0x120, b"3")]
    bench.bus.arrived = [mine[0], Frame(0x120, b"x", is_extended=True), mine[1], Frame(0x122, b"y"), mine[2]]
    bench.assembly.exchange(None)
    assert bench.left.taken == [mine[0], mine[2]]
    assert bench.right.taken == [mine[1]]


def test_two_devices_that_want_the_same_frame_are_refused(bench: Bench) -> None:
    with pytest.raises(ValueError, match=r"^left and other both listen to frame 0x120$"):
        Assembly(bench.bus, [bench.left, Wheel(bench.bus, "other", 0x120)])


def test_two_devices_that_measure_the_same_are_refused(bench: Bench) -> None:
    with pytest.raises(ValueError, match=r"^left measures left\.velocity, which another device measures$"):
        Assembly(bench.bus, [bench.left, Wheel(bench.bus, "left", 0x130)])


def test_each_drive_gets_its_own_commands_after_what_arrived_was_taken(bench: Bench) -> None:
    sensors = bench.assembly.exchange((0.5, -0.25))
    assert [frame.data for frame in bench.bus.sent] == [b"(0.5,)", b"(-0.25,)"]
    assert (sensors.values, sensors.ages, sensors.valid) == ((0.0, 0.0), (0.0, 0.0), (True, True))


def test_an_exchange_without_commands_sends_nothing(bench: Bench) -> None:
    bench.assembly.exchange(None)
    assert bench.bus.sent == []


def test_ready_once_every_drive_follows(bench: Bench) -> None:
    assert bench.assembly.exchange(None).ready is False
    bench.left.is_enabled = True
    assert bench.assembly.exchange(None).ready is False
    bench.right.is_enabled = True
    assert bench.assembly.exchange(None).ready is True


def test_off_where_every_drive_reports_so_and_none_is_commanded_on(bench: Bench) -> None:
    assert bench.assembly.exchange(None).off is True
    for silent in (bench.left, bench.right):
        silent.is_off = False
        assert bench.assembly.exchange(None).off is False
        silent.is_off = True
    bench.assembly.arm()
    assert bench.assembly.exchange(None).off is False
    bench.assembly.disarm()
    assert bench.assembly.exchange(None).off is True


def test_arming_asks_every_device_first_and_enables_none_where_one_objects(bench: Bench) -> None:
    bench.left.reasons, bench.right.reasons = ["left: hot"], ["right: silent", "right: no watchdog"]
    with pytest.raises(ArmingRefusedError) as caught:
        bench.assembly.arm()
    assert caught.value.reasons == ("left: hot", "right: silent", "right: no watchdog")
    assert (bench.left.told, bench.right.told) == ([], [])


def test_arming_enables_and_disarming_disables_every_drive(bench: Bench) -> None:
    bench.assembly.arm()
    bench.assembly.disarm()
    assert bench.left.told == bench.right.told == ["enable", "disable"]


def test_closing_disarms_first(bench: Bench) -> None:
    bench.assembly.close()
    assert bench.left.told == ["disable"]
    assert bench.bus.journal == ["close"]


def test_faults_of_all_drives_are_reported(bench: Bench) -> None:
    bench.left.fault, bench.right.fault = ("left: hot",), ("right: silent",)
    assert bench.assembly.exchange(None).faults == ("left: hot", "right: silent")


def test_lost_link_is_raised_to_the_caller(bench: Bench) -> None:
    bench.bus.is_gone = True
    with pytest.raises(LinkLostError):
        bench.assembly.exchange((0.0, 0.0))


def test_health_names_the_link_and_each_device(bench: Bench) -> None:
    assert bench.assembly.health == {
        "link": "can",
        "link.state": "active",
        "left.taken": "0",
        "right.taken": "0",
        "strange_commands": "0",
        "doubled_telemetry": "0",
    }


@pytest.fixture
def pair() -> Bench:
    """A redundant pair whose lines have both just been heard."""
    bench = Bench(redundant=True)
    bench.hear(bench.bus)
    bench.hear(bench.line)
    bench.assembly.exchange(None)
    return bench


def test_a_silent_bus_leads_to_the_serial_line_with_the_drives_enabled_anew(pair: Bench) -> None:
    pair.arm()
    pair.now_ns += 21 * MS
    sensors = pair.assembly.exchange((1.0, 1.0))
    assert sensors.events == ("link: from can to serial: no good frame for 21.0 ms",)
    assert sensors.ready is False
    assert pair.left.told == pair.right.told == ["enable", "disable", "enable"]
    assert pair.bus.sent == [], "nothing more is sent on the line that was left"
    assert len(pair.line.sent) == 2


def test_a_disarmed_robot_changes_lines_without_enabling_anything(pair: Bench) -> None:
    pair.now_ns += 21 * MS
    pair.assembly.exchange((0.0, 0.0))
    assert pair.left.told == pair.right.told == ["disable"]


def test_a_frame_that_was_refused_does_not_keep_a_line_alive(pair: Bench) -> None:
    pair.now_ns += 21 * MS
    pair.bus.arrived = [Frame(0x120, b"bad", pair.now_ns), Frame(0x121, b"", pair.now_ns)]
    assert pair.assembly.exchange(None).events == ("link: from can to serial: no good frame for 21.0 ms",)


def test_both_gaps_are_reported_and_kept(pair: Bench) -> None:
    pair.arm()
    pair.now_ns += 21 * MS
    pair.assembly.exchange((1.0, 1.0))
    pair.now_ns += 10 * MS
    pair.hear(pair.line)
    assert pair.assembly.exchange((1.0, 1.0)).events == ("link: telemetry is back 31.0 ms after the last good frame",)
    pair.now_ns += 10 * MS
    pair.left.is_enabled = pair.right.is_enabled = True
    assert pair.assembly.exchange((1.0, 1.0)).events == (
        "link: the motors follow again 41.0 ms after the last good frame",
    )
    assert pair.assembly.switching is not None
    (switch,) = pair.assembly.switching.switches
    assert (switch.telemetry_gap_ns, switch.torque_gap_ns) == (31 * MS, 41 * MS)
    assert pair.assembly.health["link.owner"] == "serial"
    assert pair.assembly.health["link.switches"] == "1"


def test_values_a_little_old_are_used_only_while_another_line_is_good(pair: Bench) -> None:
    pair.arm()
    pair.left.age, pair.right.age = 0.0599, 0.0601
    seen = [pair.assembly.exchange(None).valid]
    pair.now_ns += 21 * MS
    seen.append(pair.assembly.exchange(None).valid)
    pair.now_ns += 1_000 * MS
    seen.append(pair.assembly.exchange(None).valid)
    # The serial line is good; it has become the owner just now; and then neither line is heard any more.
    assert seen == [(True, False), (True, False), (False, False)]


def test_a_sensor_that_only_the_bus_reaches_is_given_no_patience(pair: Bench) -> None:
    imu = Wheel(pair.bus, "imu", 0x32)
    imu.age = 0.05
    link = RedundantLink(pair.bus, pair.line, pair.now)
    assembly = Assembly(link, [pair.left, pair.right], [imu], now_ns=pair.now)
    pair.hear(pair.bus)
    pair.hear(pair.line)
    assert assembly.exchange(None).valid == (True, True, False)


def test_sensor_on_the_bus_alone_is_received_whichever_line_is_the_owner(pair: Bench) -> None:
    imu = Wheel(pair.bus, "imu", 0x32)
    link = RedundantLink(pair.bus, pair.line, pair.now)
    assembly = Assembly(link, [pair.left, pair.right], [imu], now_ns=pair.now)
    link.pass_over()
    measured = Frame(0x32, b"rate", pair.now_ns)
    pair.bus.arrived, pair.line.arrived = [measured], []
    assembly.exchange(None)
    assert imu.taken == [measured]
    seen = [link.standby_is_good]
    pair.hear(pair.bus, right=False)
    before = len(pair.left.taken)
    assembly.exchange(None)
    seen.append(link.standby_is_good)
    assert seen == [False, True], "only a drive that is heard there makes a line good"
    assert len(pair.left.taken) == before, "and a drive is obeyed over the owner alone"


def test_one_line_knows_of_no_switching(bench: Bench) -> None:
    assert bench.assembly.switching is None


def test_arming_failures_are_those_of_every_device_and_arming_asks_for_them(bench: Bench) -> None:
    assert list(bench.assembly.arming_failures()) == []
    bench.left.reasons, bench.right.reasons = ["left: mend it"], ["right: mend it", "and this"]
    assert list(bench.assembly.arming_failures()) == ["left: mend it", "right: mend it", "and this"]
    with pytest.raises(ArmingRefusedError) as refused:
        bench.assembly.arm()
    assert list(refused.value.reasons) == list(bench.assembly.arming_failures())
    assert "enable" not in bench.left.told + bench.right.told


def test_nothing_is_in_the_way_of_no_hardware() -> None:
    assert not NoHardware().arming_failures()


def test_frames_of_another_end_the_commands_in_the_same_exchange(bench: Bench) -> None:
    bench.hear(bench.bus)
    bench.arm()
    assert bench.assembly.exchange((1.0, 2.0)).faults == ()
    bench.bus.arrived.append(Frame(0x130, b"", bench.now_ns))
    bench.left.told.clear()
    sensors = bench.assembly.exchange((1.0, 2.0))

    assert sensors.faults[0].startswith("command frames that this node did not send, 0x130 (1): ")
    assert bench.left.told == ["disable"]


def test_on_a_line_in_standby_a_drive_may_pass_commands_on_to_another(pair: Bench) -> None:
    """As VESC controllers do: what one of two is told over the serial line for the other, it sends on the bus."""
    pair.arm()
    pair.line.arrived.append(Frame(0x130, b"", pair.now_ns))

    assert pair.assembly.exchange((1.0, 2.0)).faults == ()


def send_telemetry(bench: Bench, wire: Wire, cycles: int, *, doubled: bool = False) -> list[tuple[str, ...]]:
    """The faults of exchanges 5 ms apart, with a frame of the left wheel in each, or two."""
    faults = []
    for _ in range(cycles):
        bench.now_ns += 5 * MS
        wire.arrived += [
            Frame(0x120, mark + bench.now_ns.to_bytes(8, "big"), bench.now_ns - before)
            for mark, before in ((b"", 2 * MS), (b"x", 0))[: 1 + doubled]
        ]
        faults.append(bench.assembly.exchange((0.0, 0.0)).faults)
    return faults


def with_rate(*, redundant: bool = False) -> Bench:
    bench = Bench(redundant=redundant)
    link = RedundantLink(bench.bus, bench.line, bench.now) if redundant else bench.bus
    bench.left.periods_s = {FrameKey(0x120): 0.005}
    bench.assembly = Assembly(link, [bench.left, bench.right], now_ns=bench.now)
    return bench


def test_second_sender_of_telemetry_is_a_fault_in_the_second_cycle_and_refuses_arming() -> None:
    bench = with_rate()
    send_telemetry(bench, bench.bus, 100)
    bench.arm()
    assert send_telemetry(bench, bench.bus, 100)[-1] == ()
    first, second = send_telemetry(bench, bench.bus, 2, doubled=True)
    assert first == ()
    assert second[0].startswith("more telemetry than the device sends, 0x120 (every 5 ms): ")
    assert bench.assembly.health["doubled_telemetry"] == "1"
    bench.assembly.disarm()
    with pytest.raises(ArmingRefusedError, match="within the last second, more telemetry than the device sends, 0x120"):
        bench.assembly.arm()
    send_telemetry(bench, bench.bus, 200)
    bench.arm()


def test_what_queued_before_the_first_exchange_is_nobody_elses() -> None:
    bench = with_rate()
    bench.bus.arrived = [Frame(0x120, bytes([n]), n * 5 * MS) for n in range(200)]
    send_telemetry(bench, bench.bus, 5)
    assert bench.assembly.health["doubled_telemetry"] == "0"


def test_a_serial_line_has_one_sender_at_a_rate_of_its_own() -> None:
    bench = with_rate(redundant=True)
    assert bench.assembly.switching is not None
    bench.assembly.switching.link.pass_over()
    send_telemetry(bench, bench.line, 20, doubled=True)
    assert bench.assembly.health["doubled_telemetry"] == "0"
