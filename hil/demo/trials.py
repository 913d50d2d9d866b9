# SPDX-License-Identifier: MIT
"""What can be done to the robot that is shown, each a button; and what its safety did, in one sentence."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.deploy.station.views import RobotView, TrialView
from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.hil.demo.parts import Part, Parts
from segway_ecc.hil.play.stage import FORCE, PUSH_N, PUSH_S

RECOVER: Final = "recover"
"""The trial that undoes all others."""
PAYLOAD: Final = "Payload"
SLOPE: Final = "Slope"
_PAYLOAD_KG: Final = 1.5
_SLOPE_RAD: Final = 0.087
"""5 degrees. Of payload and slope the segway is required to take as much, and takes more: docs/segway.md."""
_LOOK_NS: Final = 1_200_000_000
"""How long a robot is watched after something was done to it."""
_LOOKS_EVERY_NS: Final = 50_000_000
_OFF_NS: Final = 400_000_000
"""Motors that were not driven for so long are off: one that balances is driven without a pause."""
_STATES: Final = (FORCE, PAYLOAD, SLOPE)

Look = Callable[[], RobotView | None]
"""The robot as the station sees it now."""
Deed = Callable[[Parts, Clock], int]
"""Does something to the robot; returns when, monotonic, ns."""


class Trial(NamedTuple):
    """Something that can be done to the robot.

    Attributes:
        view: What the page knows of it.
        needs: The state of the plant, or the part that is measured, such as `imu`, without which it cannot be done.
    """

    view: TrialView
    do: Deed
    needs: str = ""


class Watched(NamedTuple):
    """What became of the robot after something was done to it.

    Attributes:
        zero_after_s: How long afterwards the torque ended, s; None where it drives on.
        most_pitch: The most that it leaned meanwhile, rad; None where it reports no tilt.
        robot: How it is now, as the station sees it; None where it sees none.
    """

    zero_after_s: float | None
    most_pitch: float | None
    robot: RobotView | None


def trials_for(states: Sequence[str], measured: Sequence[str]) -> tuple[Trial, ...]:
    """The trials of a plant with these states and measured values."""
    there = {"", *states, *(name.partition(".")[0] for name in measured)}
    return tuple(trial for trial in _TRIALS if trial.needs in there)


def heal(parts: Parts, states: Sequence[str]) -> None:
    """Undo everything that a trial did to plant, bus and processes."""
    parts.tell("heal")
    for state in _STATES:
        if state in states:
            parts.tell(f"write {state} 0")
    parts.revive()


def watch(parts: Parts, look: Look, clock: Clock, since_ns: int) -> Watched:
    """Watch the robot for a while; something was done to it at `since_ns`, monotonic."""
    pitches = list[float]()
    until_ns = clock.now_ns() + _LOOK_NS
    while clock.now_ns() < until_ns:
        robot = look()
        if robot is not None and robot.pitch is not None:
            pitches.append(abs(robot.pitch))
        clock.sleep_until_ns(clock.now_ns() + _LOOKS_EVERY_NS)
    driven_ns, now_ns = parts.last_driven_ns(), clock.now_ns()
    is_off = driven_ns is None or now_ns - driven_ns > _OFF_NS
    zero_after_s = max((driven_ns or since_ns) - since_ns, 0) / NS_PER_S if is_off else None
    return Watched(zero_after_s, max(pitches, default=None), look())


def sentence(seen: Watched) -> str:
    """What safety did, and how long it took, for a person."""
    robot = seen.robot
    if seen.zero_after_s is None:
        leaned = "" if seen.most_pitch is None else f", and leaned by {math.degrees(seen.most_pitch):.1f}° at most"
        return f"it drives on{leaned}"
    after = f"zero torque after {seen.zero_after_s * 1e3:.0f} ms"
    if robot is None or not robot.is_alive:
        return f"{after}; its node is not heard any more"
    posture = f" {robot.posture}" if robot.posture else ""
    first, *others = robot.reason.split("; ")
    more = f", and {len(others)} more" if others else ""
    return f"{after}; {robot.mode}{posture}: {first}{more}"


def _push(force: float) -> Deed:
    def push(parts: Parts, clock: Clock) -> int:
        since_ns = parts.tell(f"write {FORCE} {force}")
        clock.sleep_until_ns(clock.now_ns() + round(PUSH_S * NS_PER_S))
        parts.tell(f"write {FORCE} 0")
        return since_ns

    return push


def _killed(part: Part) -> Deed:
    return lambda parts, _: parts.kill(part)


def _told(line: str) -> Deed:
    return lambda parts, _: parts.tell(line)


def _trial(words: tuple[str, str, str], do: Deed, needs: str = "") -> Trial:
    name, title, effect = words
    return Trial(TrialView(name=name, title=title, effect=effect), do, needs)


_TRIALS: Final = (
    _trial(("push", "Push", f"{PUSH_N:g} N from behind for {PUSH_S:g} s"), _push(PUSH_N), FORCE),
    _trial(("push-back", "Push back", f"{PUSH_N:g} N from ahead for {PUSH_S:g} s"), _push(-PUSH_N), FORCE),
    _trial(("load", "Load", f"{_PAYLOAD_KG:g} kg put on it"), _told(f"write {PAYLOAD} {_PAYLOAD_KG}"), PAYLOAD),
    _trial(("slope", "Tilt the floor", "5° up, ahead of it"), _told(f"write {SLOPE} {_SLOPE_RAD}"), SLOPE),
    _trial(("cut", "Cut the cable", "nothing passes between the computer and the drives"), _told("cut")),
    _trial(("mute", "Silence the drives", "they receive, and nothing of theirs arrives"), _told("mute")),
    _trial(("freeze-imu", "Freeze the IMU", "it goes on sending its last values"), _told("freeze imu"), "imu"),
    _trial(("freeze-wheel", "Freeze an encoder", "the left one sends its last values"), _told("freeze left"), "left"),
    _trial(("kill-node", "Kill the node", "the process that controls ends, as by a crash"), _killed("node")),
    _trial(("kill-guard", "Kill the guard", "the process that watches the node ends"), _killed("guard")),
)
