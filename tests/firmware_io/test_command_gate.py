# SPDX-License-Identifier: MIT
"""Whether commands may leave, and what is said where they may not."""

from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.firmware_io.command_gate import CommandGate
from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.heartbeat import BusOwnedError
from segway_ecc.firmware_io.links.link import Frame

MS = 1_000_000
OURS = Frame(0x110, b"go")
STRANGE = "command frames that this node did not send, 0x110 (1): "


class Owner:
    """What the gate does with its bus."""

    def __init__(self) -> None:
        self.journal: list[str] = []
        self.has_guard = True
        self.needs_guard = False
        self.stops = ""
        self.at_pause: Callable[[], None] = lambda: None

    def open(self) -> None:
        self.journal.append("open")

    def pause(self) -> None:
        self.at_pause()

    def beat(self, *, is_on: bool) -> None:
        self.journal.append("on" if is_on else "off")

    def close(self) -> None:
        self.journal.append("close")


class Drive:
    commanded_by = (FrameKey(0x110),)

    def __init__(self) -> None:
        self.found: tuple[str, ...] = ()

    def faults(self) -> tuple[str, ...]:
        return self.found


class Wire:
    description = "the bus"

    def __init__(self) -> None:
        self.arriving: list[list[Frame]] = []
        self.is_lost = False
        self.closed = 0

    def receive(self) -> list[Frame]:
        if self.is_lost:
            raise LinkLostError("gone")
        return self.arriving.pop(0) if self.arriving else []

    def close(self) -> None:
        self.closed += 1


class Bench:
    def __init__(self, *, has_owner: bool = True, stale_ms: int | None = 40) -> None:
        self.now_ms = 1_000
        self.owner, self.drive, self.wire = Owner(), Drive(), Wire()
        self.events: list[str] = []
        drives: Any = [self.drive]
        stale_ns = None if stale_ms is None else stale_ms * MS
        self.gate = CommandGate(drives, self.owner if has_owner else None, stale_ns, lambda: self.now_ms * MS)

    def passes(self, *, is_armed: bool = True) -> bool:
        return self.gate.passes(self.events, is_armed=is_armed)

    def look(self) -> None:
        wire: Any = self.wire
        self.gate.look_for_another(wire)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_commands_pass_with_a_heartbeat_each(bench: Bench) -> None:
    bench.gate.begin()
    for _ in range(3):
        bench.now_ms += 40
        assert bench.passes()

    assert bench.owner.journal == ["on"] * 3
    assert (bench.gate.faults, bench.events) == ((), [])


def test_a_command_that_is_too_late_does_not_pass_until_the_robot_is_armed_again(bench: Bench) -> None:
    bench.gate.begin()
    bench.now_ms += 41
    bench.drive.found = ("the drive switched itself off",)
    assert not bench.passes()
    assert bench.gate.faults == ("this node sent no command for 41 ms", "the drive switched itself off")
    assert bench.owner.journal == ["on", "off"]
    bench.now_ms += 5
    assert not bench.passes()
    assert bench.owner.journal == ["on", "off", "off"]
    bench.gate.end()
    bench.now_ms += 500
    bench.gate.begin()
    bench.now_ms += 5

    assert bench.passes()


def test_a_robot_that_was_disarmed_has_no_faults(bench: Bench) -> None:
    bench.gate.begin()
    bench.now_ms += 41
    assert not bench.passes()
    bench.gate.end()

    assert bench.gate.faults == ()


def test_of_a_robot_at_rest_commands_of_any_age_pass(bench: Bench) -> None:
    bench.now_ms += 10_000

    assert bench.passes(is_armed=False)


def test_without_a_limit_commands_of_any_age_pass() -> None:
    bench = Bench(has_owner=False, stale_ms=None)
    bench.gate.begin()
    bench.now_ms += 10_000

    assert bench.passes()
    assert bench.gate.health == {"strange_commands": "0", "doubled_telemetry": "0"}
    assert list(bench.gate.arming_failures()) == []
    bench.gate.claim()
    bench.look()
    bench.gate.end()
    bench.gate.close()


def test_a_guard_that_stopped_the_drives_is_named_and_its_frames_are_not_strange(bench: Bench) -> None:
    bench.gate.begin()
    bench.now_ms += 10
    bench.owner.stops = "no heartbeat"
    bench.gate.strangers.take_frame(OURS)

    assert not bench.passes()
    assert bench.gate.faults == ("the guard stopped the drives: no heartbeat",)
    assert list(bench.gate.arming_failures())[-1].startswith("the guard is stopping the drives: no heartbeat; ")


def test_commands_of_others_are_named_and_end_ours_at_once(bench: Bench) -> None:
    bench.gate.begin()
    bench.gate.strangers.take_frame(OURS)

    assert not bench.passes()
    (fault,) = bench.gate.faults
    assert fault.startswith(STRANGE)
    assert bench.gate.health["strange_commands"] == "1"


def test_beside_a_robot_at_rest_they_are_an_event_once_and_speak_against_arming(bench: Bench) -> None:
    for _ in range(300):
        bench.gate.strangers.take_frame(OURS)
        assert bench.passes(is_armed=False)
        bench.now_ms += 10
    (event,) = bench.events
    assert event.startswith(STRANGE)
    assert next(iter(bench.gate.arming_failures())).startswith("another controller commanded this robot's drives")
    bench.now_ms += 1_000
    assert list(bench.gate.arming_failures()) == []
    bench.passes(is_armed=False)
    bench.gate.strangers.take_frame(OURS)
    bench.passes(is_armed=False)

    assert len(bench.events) == 2


def test_stop_frames_of_the_guard_beside_a_robot_at_rest_are_no_event(bench: Bench) -> None:
    bench.owner.stops = "a drive is on"
    bench.gate.strangers.take_frame(OURS)
    bench.passes(is_armed=False)

    assert bench.events == []


def test_a_guard_that_ends_is_reported_at_once_and_one_that_is_back(bench: Bench) -> None:
    assert bench.gate.health["guard"] == "watches"
    bench.gate.begin()
    assert bench.passes()
    bench.owner.has_guard = False
    assert bench.passes()
    assert bench.passes()
    assert [event.split(":")[0] for event in bench.events] == ["the guard of this bus has ended or does not answer"]
    assert bench.gate.health["guard"] == "lost"
    bench.owner.has_guard = True
    assert bench.passes()
    assert bench.events[1:] == ["the guard of this bus is back"]

    assert bench.gate.health["guard"] == "watches"


def test_a_guard_that_was_never_there_is_not_missed_unless_it_is_required(bench: Bench) -> None:
    bench.owner.has_guard = False
    bench.passes(is_armed=False)
    assert (bench.events, list(bench.gate.arming_failures())) == ([], [])
    assert bench.gate.health["guard"] == "none"
    bench.owner.needs_guard = True
    (reason,) = bench.gate.arming_failures()
    assert reason.startswith("no guard watches this bus: start `segway-ecc guard`")
    bench.owner.has_guard = True

    assert list(bench.gate.arming_failures()) == []


def test_a_bus_on_which_nobody_commands_our_drives_is_used(bench: Bench) -> None:
    bench.wire.arriving = [[Frame(0x200, b"")]] * 5
    bench.look()

    assert set(bench.owner.journal) == {"off"}
    assert bench.wire.closed == 0


@pytest.mark.parametrize("look", range(5))
def test_a_bus_on_which_somebody_does_is_refused_before_anything_is_sent(bench: Bench, look: int) -> None:
    bench.wire.arriving = [[]] * look + [[OURS]]
    with pytest.raises(BusOwnedError, match=r"^the bus: command frames that this node did not send, 0x110 \(1\): "):
        bench.look()

    assert bench.wire.closed == 1


def test_frames_of_a_guard_that_stops_the_drives_of_a_node_before_us_do_not_refuse_it(bench: Bench) -> None:
    def stop() -> None:
        bench.owner.stops = "no heartbeat"

    bench.wire.arriving = [[OURS]] * 5
    bench.owner.at_pause = stop
    bench.look()

    assert bench.wire.closed == 0


def test_a_bus_that_is_gone_is_left_to_the_loop(bench: Bench) -> None:
    bench.wire.is_lost = True
    bench.look()

    assert bench.wire.closed == 0


def test_the_bus_is_claimed_and_given_back(bench: Bench) -> None:
    bench.gate.claim()
    bench.gate.end()
    bench.gate.close()

    assert bench.owner.journal == ["open", "off", "close"]
