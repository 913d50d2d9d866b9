# SPDX-License-Identifier: MIT
"""A wheel board under 23,000 frames a second that are not its host's: noise under its identifiers, and recordings."""

import itertools
import random
from collections.abc import Iterator, Sequence
from typing import Final

import pytest

from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

FRAMES_PER_S: Final = 23_000
REPLAYS_PER_S: Final = 300
"""Of the hour: as many as were seen to be taken by version 1. The short tests replay as fast as the bus carries."""
PER_TICK: Final = FRAMES_PER_S * TICK_NS // 1_000_000_000
TICKS_PER_S: Final = 1_000_000_000 // TICK_NS
CYCLE_TICKS: Final = 2
IDENTIFIERS: Final = {1: (0x110, 0x111), 2: (0x112, 0x113, 0x114)}
AT_REST = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}
KEPT: Final = 20_000
_STEP_V: Final = 0.0005
"""Half a step of a voltage on the wire."""
BETWEEN_HALVES: Final = 7
"""Frames that a bus which is full with others carries between the two frames of a command; here more than its worst."""


class Attacked:
    """A board with its host at 100 Hz, and an attacker who sends under the identifiers of commands and nothing else."""

    def __init__(self, protocol: int) -> None:
        settings = WheelBoardSettings(watchdog_s=0.04, protocol=2 if protocol == 2 else 1)
        self.now_ns = 0
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self._host_link, self._board_link = bus.attach("host"), bus.attach("board")
        self.board = SimulatedWheelBoard(self._board_link, settings)
        self.host = WheelBoard(self._host_link, settings, 0.01, lambda: self.now_ns)
        self.recording: list[Frame] = []
        self.sent = self.ticks = 0
        self.wanted = (0.0, 0.0)
        self._identifiers = IDENTIFIERS[protocol]
        self._dice = random.Random(protocol)  # noqa: S311 - the same attack every time is wanted
        self.host.start()

    def tick(self, attack: Sequence[Frame] = ()) -> None:
        """One pass of the board's loop, each second one with a command; the attacker's frames come all about it."""
        self.ticks += 1
        self.now_ns += TICK_NS - 1_000
        for frame in self._host_link.receive():
            self.host.take_frame(frame)
        if self.ticks % CYCLE_TICKS == 0:
            self.wanted = (self.ticks % 60_000 / 2_000 - 15.0, 15.0 - self.ticks % 60_000 / 2_000)
            self.host.command(self.wanted)
        self.now_ns += 1_000
        genuine = self._board_link.receive()
        first = len(attack) // 2
        mixed = [*attack[:first], *genuine[:1], *attack[first : first + BETWEEN_HALVES]]
        self.board.obey([*mixed, *genuine[1:], *attack[first + BETWEEN_HALVES :]], self.now_ns, AT_REST)
        self.board.send_telemetry(self.now_ns, AT_REST)
        self.sent += len(attack)
        if len(self.recording) < KEPT:
            self.recording += genuine
        elif genuine:  # of all that was ever sent
            self.recording[self._dice.randrange(KEPT)] = genuine[-1]

    def begin(self) -> None:
        """Switch the motors on, undisturbed."""
        for _ in range(20):
            self.tick()
        assert self.host.arming_failures() == []
        self.host.enable()
        for _ in range(20):
            self.tick()
        assert self.host.is_enabled
        self.sent = 0
        self.before = self.board.refused_frames

    def noise(self) -> Iterator[Sequence[Frame]]:
        """Random bytes under the identifiers of commands, in each tick."""
        dice = self._dice
        identifiers = [self._identifiers[n % len(self._identifiers)] for n in range(PER_TICK)]
        starts = range(0, 8 * PER_TICK, 8)
        while True:
            data = dice.randbytes(8 * PER_TICK)
            yield list(map(Frame, identifiers, [data[start : start + 8] for start in starts]))

    def replays(self, per_s: int = FRAMES_PER_S) -> Iterator[Sequence[Frame]]:
        """What was ever sent, of this session and those before it, in any order and in its own."""
        sent = 0
        for ticks in itertools.count(1):
            count = ticks * per_s // TICKS_PER_S - sent
            sent += count
            start = self._dice.randrange(max(len(self.recording) - count, 1))
            in_order = self.recording[start : start + count // 2]
            yield [*in_order, *self._dice.choices(self.recording, k=count - len(in_order))]

    @property
    def follows(self) -> bool:
        """Whether the motors do what the host wants, and nothing else."""
        (left, right), (wanted_left, wanted_right) = self.board.voltages, self.wanted
        is_near = abs(left - wanted_left) <= _STEP_V and abs(right - wanted_right) <= _STEP_V
        return self.board.state is BoardState.ENABLED and is_near


def _after_an_earlier_session(protocol: int) -> Attacked:
    """A board that is driven, of which an attacker has a recording of 10 s of another session, armed and disarmed."""
    attacked = Attacked(protocol)
    attacked.begin()
    for _ in range(10 * TICKS_PER_S):
        attacked.tick()
    attacked.host.disable()
    for _ in range(20):
        attacked.tick()
    recording = attacked.recording
    again = Attacked(protocol)
    if again.board._session is not None:
        again.board._session.begin(2)  # switched on once more: its count of sessions
    again.begin()
    again.recording = recording
    return again


def _attack(attacked: Attacked, kind: str, seconds: int, per_s: int = FRAMES_PER_S) -> int:
    """Attack for some time; returns the ticks in which the motors did not follow the host."""
    frames = attacked.noise() if kind == "noise" else attacked.replays(per_s)
    astray = 0
    for _ in range(seconds * TICKS_PER_S):
        attacked.tick(next(frames))
        astray += not attacked.follows
    return astray


def _check(attacked: Attacked, kind: str, seconds: int, per_s: int = FRAMES_PER_S) -> None:
    assert _attack(attacked, kind, seconds, per_s) == 0
    assert attacked.sent == seconds * per_s
    assert attacked.board.refused_frames - attacked.before == attacked.sent
    assert attacked.host.is_enabled
    assert attacked.host.faults() == ()
    assert attacked.host.health["refused_frames"] != "0"


@pytest.mark.parametrize("kind", ["noise", "replays"])
def test_attack_on_an_enabled_board_moves_and_stops_nothing_and_is_counted(kind: str) -> None:
    _check(_after_an_earlier_session(2), kind, 3)


@pytest.mark.parametrize("kind", ["noise", "replays"])
def test_version_1_does_not_withstand_it(kind: str) -> None:
    """That the test above can fail."""
    assert _attack(_after_an_earlier_session(1), kind, 3) > 0


@pytest.mark.parametrize("kind", ["noise", "replays"])
def test_attack_on_a_board_at_rest_moves_nothing_and_it_can_be_armed_after(kind: str) -> None:
    attacked = _after_an_earlier_session(2)
    attacked.host.disable()
    attacked.tick()
    attacked.tick()
    attacked.before, attacked.sent = attacked.board.refused_frames, 0
    frames = attacked.noise() if kind == "noise" else attacked.replays()
    for _ in range(2 * TICKS_PER_S):
        attacked.tick(next(frames))
        assert (attacked.board.state, tuple(attacked.board.voltages)) == (BoardState.DISABLED, (0.0, 0.0))
    assert attacked.board.refused_frames - attacked.before == attacked.sent
    attacked.begin()


@pytest.mark.proof
@pytest.mark.parametrize(("kind", "per_s"), [("noise", FRAMES_PER_S), ("replays", REPLAYS_PER_S)])
def test_hour_of_attack_moves_and_stops_nothing_and_is_counted(kind: str, per_s: int) -> None:
    _check(_after_an_earlier_session(2), kind, 3_600, per_s)
