# SPDX-License-Identifier: MIT
"""What a fault is (which part fails, how, when, and by how much), and when it is there in a run in lock step."""

import random
from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Final, Literal, NamedTuple

import msgspec

from segway_ecc.firmware_io.value import Section
from segway_ecc.hil.rig.simulated_bus import NowNs

Target = Literal[
    "imu",
    "left_motor",
    "right_motor",
    "motor",
    "drive",
    "encoder",
    "can",
    "serial",
    "command_link",
    "battery",
    "clock",
    "process",
    "disk",
    "stranger",
    "model",
    "odometry",
    "operator",
    "parameter",
    "ros",
]
Type = Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "oscillating", "swapped", "stale"]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)]
_NS_PER_S: Final = 1_000_000_000
_ANY: Final = 1e308
_SPREAD_S: Final = 0.02
"""How much later than declared a seed other than zero may make a fault: anywhere in a cycle."""


class FaultKind(NamedTuple):
    """What a type of fault does to a target.

    The amount is the one where none is given, None where it means something else than any number would; it is counted
    in the unit, empty where it has no meaning.
    """

    does: str
    amount: float | None = None
    unit: str = ""
    least: float = -1e6
    most: float = 1e6


def _share(does: str, amount: float) -> FaultKind:
    return FaultKind(does, amount, "probability", 0.0, 1.0)


def _time(does: str, amount: float) -> FaultKind:
    return FaultKind(does, amount, "s", 1e-3, 60.0)


_MOTOR: Final = {
    "off": FaultKind("gives no torque: an open winding"),
    "stuck": FaultKind("gives this all the time", None, "the drive's unit; what it gave last where not given"),
    "garbage": FaultKind("gives noise up to this either way", 3.0, "the drive's unit", 0.0),
    "wrong": FaultKind("gives this times what the drive gives: -1 backwards, 0.5 weak", -1.0, "factor"),
    "slow": _time("follows with this time constant", 0.2),
    "delayed": _time("follows this much later", 0.1),
    "intermittent": _share("gives nothing in this share of the plant's steps", 0.5),
    "swapped": FaultKind("the two motors' cables are exchanged"),
}
KINDS: Final[Mapping[Target, Mapping[Type, FaultKind]]] = {
    "imu": {
        "off": FaultKind("sends nothing"),
        "stuck": FaultKind("measures the same all the time, and sends it as if it were new"),
        "garbage": FaultKind("measures noise up to this either way", 20.0, "rad/s and m/s2", 0.0),
        "wrong": FaultKind("measures too much by this; the opposite where not given", None, "rad/s and m/s2"),
        "slow": _time("follows with this time constant", 0.2),
        "delayed": _time("measures what was this long ago", 0.1),
        "intermittent": _share("loses this share of its frames", 0.5),
        "swapped": FaultKind("its x and y axes are exchanged"),
    },
    "left_motor": _MOTOR,  # type: ignore[dict-item]  # the keys are literals
    "right_motor": _MOTOR,  # type: ignore[dict-item]  # the keys are literals
    "motor": {kind: does for kind, does in _MOTOR.items() if kind != "swapped"},  # type: ignore[misc]  # as above
    "drive": {
        "off": FaultKind("that of the first axis ends with an error of its own, and lets its motor go"),
    },
    "encoder": {
        "off": FaultKind("reads zero, and no error"),
        "stuck": FaultKind("reads the same all the time"),
        "garbage": FaultKind("reads noise up to this either way", 50.0, "rad and rad/s", 0.0),
        "wrong": FaultKind("reads too much by this; the opposite where not given", None, "rad and rad/s"),
        "slow": _time("follows with this time constant", 0.2),
        "delayed": _time("reads what was this long ago", 0.1),
        "intermittent": _share("reads zero in this share of the plant's steps", 0.5),
        "swapped": FaultKind("those of the left and the right wheel are exchanged"),
    },
    "can": {
        "off": FaultKind("nothing passes either way, and nothing reports it: a cut cable"),
        "stuck": FaultKind("the transmit queue takes nothing; telemetry goes on"),
        "stale": FaultKind("no telemetry arrives; commands do"),
        "garbage": _share("some bits are wrong in this share of the frames either way", 0.1),
        "wrong": FaultKind(
            "after each frame the one of its kind before it arrives once more: a counter that goes back"
        ),
        "delayed": _time("every frame arrives this much later", 0.02),
        "intermittent": _share("this share of the frames is lost either way", 0.1),
        "swapped": FaultKind("the bytes of every frame either way are in the other order"),
    },
    "serial": {
        "off": FaultKind("the wires are cut"),
        "stuck": FaultKind("the robot's port is gone"),
        "garbage": FaultKind("noise arrives at the robot", 1000.0, "bytes/s", 1.0, 1e5),
    },
    "command_link": {
        "off": FaultKind("no set-point arrives"),
        "stuck": FaultKind(
            "the newest set-point arrives this often in every cycle: a flood", 100.0, "times", 1.0, 10_000.0
        ),
        "garbage": FaultKind("every set-point arrives as not a number, or infinite"),
        "wrong": FaultKind("every set-point asks for this much more ahead", 100.0, "m/s"),
        "delayed": _time("set-points arrive this much later", 0.2),
        "intermittent": _share("this share of the set-points is lost", 0.5),
    },
    "battery": {
        "off": FaultKind("drives and sensors are without supply, for good"),
        "slow": FaultKind("sags: the motors give this times what they should", 0.5, "factor", 0.0, 1.0),
        "intermittent": _share("the motors give nothing in this share of the plant's steps", 0.5),
    },
    "clock": {
        "stuck": FaultKind("the wall clock stops"),
        "wrong": FaultKind("the wall clock steps by this", 3600.0, "s"),
        "slow": FaultKind("the wall clock loses this much every second", 0.01, "s/s", -1.0, 1.0),
    },
    "process": {
        "off": FaultKind("the node is killed: it sends nothing more, and closes nothing"),
        "stuck": _time("the node stalls for this long, once", 0.2),
        "slow": _time("every cycle begins this much late", 0.005),
    },
    "disk": {
        "off": FaultKind("nothing can be recorded: every write fails"),
        "slow": _time("every write takes this long", 0.005),
        "intermittent": _share("this share of the snapshots is lost", 0.5),
    },
    "stranger": {
        "off": FaultKind("somebody else sends what stops the drives, this often", 100.0, "Hz", 1.0, 1000.0),
        "garbage": FaultKind(
            "somebody else sends noise under the identifiers of the devices, this often", 100.0, "Hz", 1.0, 1000.0
        ),
        "delayed": _time("somebody else plays what the devices sent this long ago", 0.5),
        "stuck": FaultKind(
            "somebody else sends the node's newest command that moves a drive, this often", 100.0, "Hz", 1.0, 1000.0
        ),
    },
    "model": {
        "off": FaultKind("its step raises an error"),
        "garbage": FaultKind("its commands are not numbers"),
        "wrong": FaultKind("its commands are too large by this", 1e308, "the drive's unit", -_ANY, _ANY),
        "oscillating": FaultKind(
            "its commands change sign in every cycle, this much either way", 18.0, "the drive's unit", 0.0, _ANY
        ),
        "slow": _time("every step takes this long", 0.012),
    },
    "odometry": {
        "wrong": FaultKind(
            "its pose and velocities, which the model gives, are too large by this",
            1e308,
            "m, rad, m/s and rad/s",
            -_ANY,
            _ANY,
        ),
    },
    "operator": {
        "off": FaultKind("presses stop"),
        "wrong": FaultKind("asks the robot to disarm"),
        "stuck": FaultKind("asks to clear the fault and to arm, in every cycle"),
    },
    "parameter": {
        "wrong": FaultKind("this is written to the variable of the model", 0.0, "the variable's unit", -_ANY, _ANY),
    },
    "ros": {
        "off": FaultKind("its process is lost: nothing arrives, nothing is published"),
    },
}
"""Every fault there is, and what it does."""

IMU_SIGNALS: Final = tuple(f"{kind}_{axis}" for kind in ("angular_velocity", "linear_acceleration") for axis in "xyz")
"""What an IMU measures."""
_ACT_AHEAD: Final = {
    *((target, "delayed") for target in ("imu", "encoder", "left_motor", "right_motor", "motor", "stranger")),
    ("can", "wrong"),
    ("stranger", "off"),
    ("stranger", "garbage"),
    ("stranger", "stuck"),
    ("model", "off"),
    ("model", "garbage"),
    ("model", "wrong"),
    ("model", "oscillating"),
    ("model", "slow"),
    ("odometry", "wrong"),
}
"""Faults for which the run is another one before they begin: it remembers what was before, has another participant on
its bus, or a model that can misbehave."""
_NAMED: Final[Mapping[Target, str]] = {"parameter": "a variable of the model", "motor": "an axis"}
"""Targets that are one of several, and what they are."""
_MAY_BE_NAMED: Final = frozenset({*_NAMED, "encoder"})
_FOR_GOOD: Final = {("battery", "off"), ("drive", "off"), ("process", "off"), ("process", "stuck")}
"""Faults whose end is not in the declaration's hands."""


class Fault(Section, frozen=True, kw_only=True):
    """One fault.

    Attributes:
        type: How; see `KINDS`.
        at_s: When, s after the robot was armed.
        for_s: How long, s; None for good.
        amount: How much; see `KINDS`. None for what stands there.
        every_s: It comes again each time after so long, s; None for once.
        since: What `at_s` counts from: when the robot was armed, or when it was switched on.
        name: The variable that is written, of a parameter; the axis of a motor, and that of an encoder which is not the
            left wheel's; of an IMU that is wrong the signal that alone is.
    """

    target: Target
    type: Type
    at_s: Seconds
    for_s: Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)] | None = None
    amount: float | None = None
    every_s: Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)] | None = None
    since: Literal["armed", "power_on"] = "armed"
    name: str | None = None

    def __post_init__(self) -> None:
        """Refuse what makes no sense; the ValueError names what does."""
        kinds = KINDS[self.target]
        kind = kinds.get(self.type)
        if kind is None:
            raise ValueError(f"{self.target} cannot be {self.type}; it can be {', '.join(kinds)}")
        if self.amount is not None and not kind.unit:
            raise ValueError(f"amount has no meaning where {self.target} is {self.type}: leave it out")
        if self.amount is not None and not kind.least <= self.amount <= kind.most:
            raise ValueError(f"amount must be from {kind.least:g} to {kind.most:g} ({kind.unit}), not {self.amount}")
        if self.for_s is not None and (self.target, self.type) in _FOR_GOOD:
            raise ValueError(f"for_s has no meaning where {self.target} is {self.type}: leave it out")
        if self.every_s is not None and (self.for_s is None or self.for_s >= self.every_s):
            raise ValueError("every_s needs a for_s that is shorter")
        self._check_name()

    @property
    def acts_ahead(self) -> bool:
        """Whether a run with it may be another one than a run without it already before the robot is armed."""
        return self.since == "power_on" or (self.target, self.type) in _ACT_AHEAD

    @property
    def size(self) -> float | None:
        """The amount, or what it is where none is given."""
        return KINDS[self.target][self.type].amount if self.amount is None else self.amount

    def _check_name(self) -> None:
        if self.target == "imu" and self.type == "wrong":
            if self.name not in {None, *IMU_SIGNALS}:
                raise ValueError(f"name of an IMU's fault is one of {', '.join(IMU_SIGNALS)}, not '{self.name}'")
        elif self.name is None and self.target in _NAMED:
            raise ValueError(f"{self.target} needs a name, that of {_NAMED[self.target]}")
        elif self.name is not None and self.target not in _MAY_BE_NAMED:
            raise ValueError(f"name has no meaning where {self.target} is {self.type}: leave it out")
        elif self.name is not None and self.type == "swapped":
            raise ValueError(f"{self.target} that is swapped is left and right: leave name out")


class Timeline:
    """Time since the robot was armed, which was at `started_ns`; None before."""

    def __init__(self, now_ns: NowNs) -> None:
        """Count on this clock once `start` was called."""
        self.started_ns: int | None = None
        self._now_ns = now_ns

    def start(self) -> None:
        """The robot was armed now, if it had not been before."""
        if self.started_ns is None:
            self.started_ns = self._now_ns()

    @property
    def elapsed_ns(self) -> int:
        """Time since the start; before it, negative."""
        return -1 if self.started_ns is None else self._now_ns() - self.started_ns


class Injection:
    """A declared fault in one run, which begins `at_ns`, ns after the robot was armed."""

    def __init__(self, fault: Fault, timeline: Timeline, seed: str) -> None:
        """Inject a fault on a timeline, which began when the robot was armed; equal seeds inject equally."""
        self.fault = fault
        self.random = random.Random(seed)  # noqa: S311 - chance that can be repeated is what is wanted
        self.at_ns = round(fault.at_s * _NS_PER_S)
        self._timeline = timeline

    @property
    def size(self) -> float:
        """The fault's amount; 0 where it means something else than any number would."""
        return self.fault.size or 0.0

    @property
    def is_active(self) -> bool:
        """Whether the fault is there now."""
        since_ns, fault = self.since_ns, self.fault
        if since_ns < 0 or fault.for_s is None:
            return since_ns >= 0
        if fault.every_s is not None:
            since_ns %= round(fault.every_s * _NS_PER_S)
        return since_ns < fault.for_s * _NS_PER_S

    @property
    def since_ns(self) -> int:
        """How long ago the fault began; negative before."""
        return self._timeline.elapsed_ns - self.at_ns

    def happens(self) -> bool:
        """Whether chance, at the fault's probability, has it happen this time."""
        return self.random.random() < self.size


class Injections:
    """All faults of one run."""

    def __init__(self, faults: Sequence[Fault], seed: int, now_ns: NowNs) -> None:
        """Make the faults of a run; seed 0 makes each exactly when declared, others up to 20 ms later."""
        self.timeline = Timeline(now_ns)
        self._switched_on = Timeline(now_ns)
        self._switched_on.start()
        self._all: list[Injection] = []
        self._given: list[tuple[Collection[Target], list[Injection]]] = []
        self.declare(faults, seed)

    def declare(self, faults: Sequence[Fault], seed: int) -> None:
        """Add faults, also to what `of` has returned; those that have an effect before they begin are too late then."""
        timelines = {"armed": self.timeline, "power_on": self._switched_on}
        offset_s = random.Random(seed).uniform(0.0, _SPREAD_S) if seed else 0.0  # noqa: S311 - as above
        for place, fault in enumerate(faults):
            injection = Injection(fault, timelines[fault.since], f"{seed}/{place}")
            injection.at_ns += round(offset_s * _NS_PER_S)
            self._all.append(injection)
            for targets, found in self._given:
                if fault.target in targets:
                    found.append(injection)

    @property
    def first_ns(self) -> int | None:
        """When the first fault begins, ns after the robot was armed, 0 where before that; None where there is none."""
        begin = (injection.at_ns if injection.fault.since == "armed" else 0 for injection in self._all)
        return min(begin, default=None)

    def of(self, *targets: Target) -> Sequence[Injection]:
        """The faults of some parts: those of now, and those that are declared later."""
        found = [injection for injection in self._all if injection.fault.target in targets]
        self._given.append((targets, found))
        return found


def active(injections: Sequence[Injection]) -> list[Injection]:
    """Those that are there now."""
    return [injection for injection in injections if injection.is_active]
