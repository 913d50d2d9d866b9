# SPDX-License-Identifier: MIT
"""A plant whose sensors measure, and whose motors push, as faults make them."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from segway_ecc.hil.devices.device import unseen_advance_of
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.faults.fault import Fault, Injection, Injections, Target
from segway_ecc.hil.rig.fronts import PlantFront
from segway_ecc.node.model.model import Model, Variable

_WHEELS = ("left.", "right.")
_PREFIXES = {
    "imu": ("imu.",),
    "encoder": ("left.",),
    "left_motor": ("left.",),
    "right_motor": ("right.",),
    "battery": ("",),
}
"""How the names of what a fault disturbs begin, where it names no axis: a battery is that of all motors."""
_EXCHANGED = (("left.", "right."), ("_x", "_y"))
"""Parts of names, which what is exchanged differs in: the wheel, and the IMU's axis."""

_MOTORS: Final[Sequence[Target]] = ("left_motor", "right_motor", "motor")
_VARYING = {
    *((motor, kind) for motor in _MOTORS for kind in ("garbage", "intermittent", "slow")),
    ("battery", "intermittent"),
    *((sensor, "slow") for sensor in ("imu", "encoder")),
}
"""Faults that give a motor something else in each step, or have to see what a sensor shows in each."""


class DisturbedPlant(PlantFront):
    """A plant with faults."""

    def __init__(self, plant: Model, injections: Injections) -> None:
        """Stand in front of `plant`.

        Raises:
            PlantMismatchError: It has nothing of what a fault disturbs.
        """
        super().__init__(plant)
        self._of_sensors = injections.of("imu", "encoder")
        self._of_motors = injections.of(*_MOTORS, "battery")
        self._sensors: list[_Disturbance] = []
        self._motors: list[_Disturbance] = []
        self._varying: list[_Disturbance] = []
        self._advance_unseen = unseen_advance_of(plant)
        self._prepare()

    def advance_unseen(self, u: Sequence[float], steps: int) -> Sequence[float]:
        """Make some steps; faults see what sensors show nevertheless; see `Unseen`."""
        if self._of_sensors or self._of_motors:
            return self.advance(u, steps)
        return self._advance_unseen(u, steps)

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make some steps, at once where none of them is disturbed otherwise than the others; see `Advancing`."""
        if not self._of_sensors and not self._of_motors:
            return super().advance(u, steps)
        if len(self._sensors) + len(self._motors) < len(self._of_sensors) + len(self._of_motors):
            self._prepare()
        if not any(disturbance.acts_each_step for disturbance in self._varying):
            return self._disturbed(u, steps)
        for _ in range(steps - 1):
            self._disturbed(u, 1)
        return self._disturbed(u, 1)

    def _prepare(self) -> None:
        """Take the faults that have been declared since."""
        for disturbances, injections, variables in (
            (self._sensors, self._of_sensors, self.outputs),
            (self._motors, self._of_motors, self.inputs),
        ):
            new = [_Disturbance(i, variables, self.step_size) for i in injections[len(disturbances) :]]
            disturbances.extend(new)
            self._varying += [each for each in new if each.may_act_each_step]

    def _disturbed(self, u: Sequence[float], steps: int) -> list[float]:
        given = list(u)
        for motor in self._motors:
            motor.disturb(given)
        measured = list(super().advance(given, steps))  # the plant may keep what it gave
        for sensor in self._sensors:
            sensor.disturb(measured)
        return measured


class _Disturbance:
    """What one fault makes of some values, one step of the plant at a time."""

    def __init__(self, injection: Injection, variables: Sequence[Variable], step_size: float) -> None:
        fault = injection.fault
        self._injection = injection
        names = [v.name for v in variables]
        prefixes = _prefixes(fault)
        self._places = [place for place, name in enumerate(names) if name.startswith(prefixes)]
        if not self._places and fault.target != "imu":  # of an IMU some faults are those of its frames
            known = ", ".join(dict.fromkeys(name.partition(".")[0] for name in names if "." in name))
            raise PlantMismatchError(
                f"a fault of {fault.target} disturbs what begins with {' or '.join(prefixes)}: the plant has none of "
                f"it; its parts are {known}"
            )
        mine = [names[place] for place in self._places]
        self._others = [mine.index(_other(name, mine)) for name in mine]
        self._step_size = step_size
        self._is_factor = fault.target in {*_MOTORS, "battery"}
        self._kept = [0.0] * len(self._places)
        self._varies = (fault.target, fault.type) in _VARYING
        length = round(injection.size / step_size) + 1 if fault.type == "delayed" else 1
        self._past: deque[list[float]] = deque(maxlen=length)

    @property
    def may_act_each_step(self) -> bool:
        """Whether there are times at which `acts_each_step`."""
        return self._varies or self._injection.fault.type == "delayed"

    @property
    def acts_each_step(self) -> bool:
        """Whether it is to see every step, or makes something else of each."""
        if self._injection.fault.type == "delayed":
            return True
        return self._varies and self._injection.is_active

    def disturb(self, values: list[float]) -> None:
        """Replace the values that are disturbed."""
        true = [values[place] for place in self._places]
        self._past.append(true)
        if not self._injection.is_active:
            self._kept = true
            return
        for place, value in zip(self._places, self._disturbed(true), strict=True):
            values[place] = value

    def _disturbed(self, true: list[float]) -> Sequence[float]:
        injection, size = self._injection, self._injection.fault.size
        match injection.fault.type:
            case "wrong":
                return [self._wrong(value) for value in true]
            case "slow":
                return self._slow(true)
            case "delayed" | "swapped" as kind:
                return self._past[0] if kind == "delayed" else [true[place] for place in self._others]
            # Of an IMU it is the frames that are lost, on the bus.
            case "intermittent" if injection.fault.target == "imu" or not injection.happens():
                return true
            case "stuck":
                return self._kept if size is None else [size] * len(true)
        bound = injection.size if injection.fault.type == "garbage" else 0.0
        return [injection.random.uniform(-bound, bound) if bound else 0.0 for _ in true]

    def _wrong(self, value: float) -> float:
        size = self._injection.fault.size
        if self._is_factor:
            return value * (-1.0 if size is None else size)
        return -value if size is None else value + size

    def _slow(self, true: list[float]) -> list[float]:
        """What lags behind; of a battery, what sags."""
        size = self._injection.size
        if self._injection.fault.target == "battery":
            return [size * value for value in true]
        share = self._step_size / (size + self._step_size)
        self._kept = [kept + share * (value - kept) for kept, value in zip(self._kept, true, strict=True)]
        return self._kept


def _prefixes(fault: Fault) -> tuple[str, ...]:
    """How the names of what a fault disturbs begin."""
    if fault.type == "swapped" and fault.target != "imu":
        return _WHEELS
    if fault.name is None:
        return _PREFIXES[fault.target]
    return (f"imu.{fault.name}",) if fault.target == "imu" else (f"{fault.name}.",)


def _other(name: str, names: Sequence[str]) -> str:
    """The one that it is exchanged with; itself where there is none."""
    for one, other in _EXCHANGED:
        for new in (name.replace(one, other), name.replace(other, one)):
            if new != name and new in names:
                return new
    return name
