# SPDX-License-Identifier: MIT
"""The ASCII protocol of ODrive firmware 0.5, checksums on every line both ways, as a `SerialCodec`.

A line is text, a star and the XOR of the text's bytes in decimal, ended by a line feed. Replies do not name what they
answer: both axes' `f` give two numbers, every `r` gives one. But the board answers in order, and at most once a line.
So each poll ends with a question that is known to be refused, `f 10` to `f 99`: its refusal, "invalid motor 10", gives
back a number that counts the polls. The replies between two refusals that follow one another are those of one poll;
where they are as many as were asked for, each stands in its place. Otherwise something was lost on the way and none is
used.

While it is in standby and no motor is on, the first polls of a line ask for the board's settings too, one in a poll,
and later one poll in ten does. A line that commands pass over has no room for that, nor has one that they may pass to
at any moment. They are handed on as `sdo.serial_answer` has it.

Source: ascii_protocol.cpp of the ODrive v3 firmware.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

from msgspec.structs import replace
from mypy_extensions import mypyc_attr

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import COMMANDS, Firmware, Message, decode, encode
from segway_ecc.firmware_io.drives.odrive.messages import AxisState, BusVoltageCurrent, EncoderEstimates, Heartbeat
from segway_ecc.firmware_io.drives.odrive.sdo import serial_answer
from segway_ecc.firmware_io.drives.odrive.setting_names import OF_BOARD, PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import LOST

_LONGEST: Final = 64
"""What the board puts into a line at the most."""
_ENDS: Final = re.compile(rb"[\r\n]+")
_CHECKED: Final = re.compile(rb"([^*]*)\*(\d{1,3})")
_ESTIMATES: Final = re.compile(rb"(-?\d{1,40}\.\d{1,9}) (-?\d{1,40}\.\d{1,9})")
_FLOAT: Final = re.compile(rb"-?\d{1,40}\.\d{1,9}")
_SETTING: Final = re.compile(rb"-?(?:inf|\d{1,40}(?:\.\d{0,9})?)")
"""A float, a flag, or no limit; the board cuts a long number after nine characters."""
_NO_SETTING: Final = b"invalid property"
_NUMBER: Final = re.compile(rb"\d{1,10}")
_MARK: Final = re.compile(rb"invalid motor (\d{2})")
_FIRST_MARK: Final = 10
_MARKS: Final = 90
_AXES: Final = (0, 1)
_SUPPLY: Final = ("r vbus_voltage", "r ibus")
_SUPPLY_EVERY: Final = 10
_SUPPLY_TURN: Final = 9
"""The last of every ten polls asks for the supply too, which changes slowly; ten divides the marks, so that a mark
shows whether its poll did."""
_SETTINGS_TURN: Final = 4
"""The poll of every ten that asks for settings once the first round is over."""
_REPLIES: Final = 6
"""To one poll; its mark, the supply and settings not counted."""
_LATE: Final = 3
"""A reply to a poll that lies this many polls back is too old: the line is too slow for what is asked."""


class _Question(NamedTuple):
    """A setting that is asked for, of one axis or, where that is None, of the board."""

    axis: int | None
    setting: OwnSetting

    @property
    def text(self) -> str:
        return f"r {PATHS[Firmware.V0_5][self.setting].format(self.axis)}"


_QUESTIONS: Final = (
    *(_Question(axis, setting) for setting in PATHS[Firmware.V0_5] if setting not in OF_BOARD for axis in _AXES),
    *(_Question(None, setting) for setting in OF_BOARD),
)


def checked(text: str) -> bytes:
    """A line with its checksum and its end."""
    data = text.encode("ascii")
    return data + b"*%d\n" % reduce(xor, data, 0)


@mypyc_attr(allow_interpreted_subclasses=True)  # as `PhasedDrive`
class OdriveSerialCodec:
    """Translates the frames of two axes of one board; see `SerialCodec`.

    Each poll asks for the estimates, state and errors of both axes; one in ten, for the supply's voltage and current,
    and one in ten for a setting, after a first round of these.
    `refused` are lines received and not taken, by cause; under `LOST` polls of whose replies some are missing.
    """

    def __init__(self, settings: OdriveSettings) -> None:
        """Speak for the wheels of one board."""
        self.refused: Counter[str] = Counter()
        self._axis_of: dict[int, int] = {wheel.node_id: wheel.axis for wheel in settings.axes.values()}
        self._node_of = {axis: node_id for node_id, axis in self._axis_of.items()}
        self._polls = 0
        self._first_poll = 0
        """Since the line was opened."""
        self._is_in_use = False
        """Whether a command was sent since the last poll."""
        self._is_driving = False
        """Whether an axis was in closed loop in the newest poll."""
        self._asked: dict[int, tuple[_Question, ...]] = {}
        """The setting that a poll asked for, by its mark."""
        self._received = b""
        self._is_too_long = False
        self._last_mark: int | None = None
        self._replies: list[bytes] = []

    def encode(self, frame: Frame) -> bytes | None:
        """The lines for a frame to one of the two nodes; None where there are none."""
        axis = self._axis_of.get(frame.arbitration_id // COMMANDS)
        if axis is None or frame.is_extended or frame.is_remote:
            return None
        try:
            message = decode(Firmware.V0_5, frame.arbitration_id, frame.data)
        except FrameRefusedError:
            return None
        self._is_in_use = True
        texts = _texts(axis, message)
        return b"".join(map(checked, texts)) if texts else None

    def request(self) -> bytes:
        """The poll: it feeds no watchdog, since only commands do on this line."""
        texts = [f"f {axis}" for axis in _AXES]
        for axis in _AXES:
            texts += [f"r axis{axis}.current_state", f"r axis{axis}.error"]
        if self._polls % _SUPPLY_EVERY == _SUPPLY_TURN:
            texts += _SUPPLY
        questions = () if self._is_in_use or self._is_driving else self._questions(self._polls)
        self._is_in_use = False
        self._asked[self._polls % _MARKS] = questions
        texts += [question.text for question in questions]
        texts.append(f"f {_FIRST_MARK + self._polls % _MARKS}")
        self._polls += 1
        return b"".join(map(checked, texts))

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """Take received bytes; see `SerialCodec.decode`."""
        *ended, rest = _ENDS.split(self._received + data)
        frames: list[Frame] = []
        for line in ended:
            if line and not self._is_too_long:
                frames += self._take(line, now_ns)
            self._is_too_long = False
        if len(rest) > _LONGEST:
            self._is_too_long = True
            self.refused["length"] += 1
            rest = b""
        self._received = rest
        return frames

    def reset(self) -> None:
        """Discard what was received of a line and of a poll; ask for the settings anew."""
        self._first_poll = self._polls
        self._received = b""
        self._is_too_long = False
        self._last_mark = None
        self._replies.clear()

    def _take(self, line: bytes, now_ns: int) -> list[Frame]:
        """Take one line; a mark completes a poll."""
        match = _CHECKED.fullmatch(line)
        if match is None or reduce(xor, match[1], 0) != int(match[2]):
            self.refused["checksum"] += 1
            return []
        mark = _MARK.fullmatch(match[1])
        if mark is not None:
            return self._complete(int(mark[1]) - _FIRST_MARK, now_ns)
        if len(self._replies) <= _REPLIES + len(_SUPPLY) + 1:
            self._replies.append(match[1])
        return []

    def _complete(self, mark: int, now_ns: int) -> list[Frame]:
        """The frames of the poll that this mark ends, counted modulo `_MARKS`."""
        replies, self._replies = self._replies, []
        previous, self._last_mark = self._last_mark, mark
        if previous is None:
            return []  # when the first of these replies was asked for is not known
        behind = (self._polls - 1 - mark) % _MARKS
        questions = self._asked.get(mark, ())
        supplies = len(_SUPPLY) if mark % _SUPPLY_EVERY == _SUPPLY_TURN else 0
        wanted = _REPLIES + supplies + len(questions)
        if mark != (previous + 1) % _MARKS or len(replies) != wanted:
            self.refused[LOST] += 1
            return []
        if behind >= _LATE:
            self.refused["late"] += 1
            return []
        try:
            frames = self._frames(replies[: _REPLIES + supplies])
            frames += self._settings(zip(questions, replies[_REPLIES + supplies :], strict=True))
        except (ValueError, FrameRefusedError):
            self.refused["reply"] += 1
            return []
        return [replace(frame, received_ns=now_ns) for frame in frames]

    def _questions(self, poll: int) -> tuple[_Question, ...]:
        """What a poll, counted from 0, asks for beside telemetry.

        The replies to a line's first poll are not used: what came before it is not known.
        """
        turn = poll - self._first_poll - 1
        if 0 <= turn < len(_QUESTIONS):
            return (_QUESTIONS[turn],)
        if poll % _SUPPLY_EVERY != _SETTINGS_TURN:
            return ()
        return (_QUESTIONS[poll // _SUPPLY_EVERY % len(_QUESTIONS)],)

    def _settings(self, answers: Iterator[tuple[_Question, bytes]]) -> Iterator[Frame]:
        """The frames of settings; raises ValueError where a reply is none to its question."""
        for (axis, setting), reply in answers:
            if reply != _NO_SETTING and _SETTING.fullmatch(reply) is None:
                raise ValueError("not a setting")
            value = math.nan if reply == _NO_SETTING else float(reply)
            for node in _AXES if axis is None else (axis,):
                yield serial_answer(self._node_of[node], setting, value)

    def _frames(self, replies: list[bytes]) -> list[Frame]:
        """The frames of one poll's replies; raises ValueError where one is no answer to its question."""
        answers = iter(replies)
        messages: list[tuple[int, Message]] = []
        for axis in _AXES:
            estimates = _ESTIMATES.fullmatch(next(answers))
            if estimates is None:
                raise ValueError("not two numbers")
            messages.append((axis, EncoderEstimates(float(estimates[1]), float(estimates[2]))))
        states = []
        for axis in _AXES:
            states.append(_number(next(answers)))
            messages.append((axis, Heartbeat(_number(next(answers)), states[-1])))
        supply = list(answers)
        if supply and all(map(_FLOAT.fullmatch, supply)):  # the board may not know one of the two
            messages += [(axis, BusVoltageCurrent(float(supply[0]), float(supply[1]))) for axis in _AXES]
        frames = [encode(Firmware.V0_5, self._node_of[axis], message) for axis, message in messages]
        self._is_driving = AxisState.CLOSED_LOOP_CONTROL in states
        return frames


def _number(reply: bytes) -> int:
    if _NUMBER.fullmatch(reply) is None:
        raise ValueError("not a number")
    return int(reply)


def _texts(axis: int, message: Message) -> list[str]:
    """The lines for a command; none where the protocol has none that this robot needs."""
    match message:
        case m.SetInputTorque(torque):
            return [f"c {axis} {torque:.6f}"]
        case m.SetAxisState(state):
            return [f"w axis{axis}.requested_state {state}"]
        case m.SetControllerMode(control_mode, input_mode):
            controller = f"w axis{axis}.controller.config"
            return [f"{controller}.control_mode {control_mode}", f"{controller}.input_mode {input_mode}"]
        case m.ClearErrors():
            return ["sc"]
    return []
