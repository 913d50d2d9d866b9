# SPDX-License-Identifier: MIT
"""All devices on one bus with the plant they share, one tick at a time."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.devices.device import Device, Sleeping, advance_of, unseen_advance_of
from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.node.model.model import Model

_NS_PER_S: Final = 1_000_000_000


class SimulatedRobot:
    """The other end of the robot's bus.

    Attributes:
        tick_ns: Period of the firmware's loops.
        inputs: What the motors give the plant, in the plant's order.
        outputs: The plant's newest outputs, in the plant's order; after a tick in which no device is due, those of an
            IMU may be older.
        devices: The devices, drives first.
        stuck: What devices measure in place of the plant's outputs, by name: sensors that show an old value.
        errors: What devices measure too much, by the output's name, in its unit.
    """

    def __init__(self, link: Link, devices: Sequence[Device], plant: Model, tick_ns: int) -> None:
        """Join devices on `link` to a plant; each plant step takes one or more ticks, or divides one.

        Raises:
            PlantMismatchError: The plant's ports or its step do not fit.
        """
        self.tick_ns = tick_ns
        self.link = link
        self.devices = tuple(devices)
        # Where one of them needs every tick, the others have it too.
        self._sleepers = [device for device in devices if isinstance(device, Sleeping)]
        self._may_sleep = len(self._sleepers) == len(self.devices)
        self.plant = plant
        self.output_names = [v.name for v in plant.outputs]
        self._driving = tuple(zip(devices, _places(devices, plant), strict=True))
        self._steps, self._ticks_per_step = _rates(plant, tick_ns)
        self._ticks = 0
        self.stuck: dict[str, float] = {}
        self.errors: dict[str, float] = {}
        self.inputs = [0.0] * len(plant.inputs)
        self.outputs: Sequence[float] = plant.initialize(self.inputs)
        self._by_name: dict[str, float] = {}
        self._by_name_of: Sequence[float] | None = None

    @property
    def plant(self) -> Model:
        """What the devices share; write to its states to disturb it."""
        return self._plant

    @plant.setter
    def plant(self, plant: Model) -> None:
        self._plant, self._advance, self._advance_unseen = plant, advance_of(plant), unseen_advance_of(plant)

    @property
    def refused_frames(self) -> int:
        """Frames that the devices refused since power-on."""
        return sum(device.refused_frames for device in self.devices)

    def tick(self, now_ns: int) -> None:
        """One pass of every device's loop at time `now_ns`, with the plant's share of time after it."""
        try:
            frames: Sequence[Frame] = self.link.receive()
        except LinkLostError:  # a bus that is gone carries nothing; what happens then is what is simulated
            frames = ()
        self._ticks += 1
        moves = self._ticks % self._ticks_per_step == 0
        is_due = not self._all_sleep(now_ns)
        # Where the plant moves in each tick, devices that are due find new outputs in that tick.
        advance = self._advance if is_due or self._ticks_per_step > 1 else self._advance_unseen
        if not (is_due or frames):
            if moves:
                self.outputs, self._by_name_of = advance(self.inputs, self._steps), None
            return
        outputs = self._measured()
        inputs = self.inputs
        for device, places in self._driving:
            given = device.obey(frames, now_ns, outputs)
            if places:
                for place, value in zip(places, given, strict=True):
                    inputs[place] = value
        if moves:
            self.outputs, self._by_name_of = advance(self.inputs, self._steps), None
            outputs = self._measured()
        for device in self.devices:
            device.send_telemetry(now_ns, outputs)

    def coast(self) -> None:
        """One tick of the plant alone, with what the motors gave it last; frames wait for the devices' next pass."""
        self._ticks += 1
        if self._ticks % self._ticks_per_step == 0:
            self.outputs, self._by_name_of = self._advance(self.inputs, self._steps), None

    def _all_sleep(self, now_ns: int) -> bool:
        """Whether no device needs a pass for its own sake."""
        if not self._may_sleep:
            return False
        for device in self._sleepers:  # noqa: SIM110 - a generator in all() takes three times as long
            if device.next_ns <= now_ns:
                return False
        return True

    def _measured(self) -> dict[str, float]:
        """The outputs by name, as the devices find them; from one step of the plant to the next they are the same."""
        if self._by_name_of is not self.outputs:
            self._by_name, self._by_name_of = dict(zip(self.output_names, self.outputs, strict=True)), self.outputs
        if not self.stuck and not self.errors:
            return self._by_name
        wrong = {name: self._by_name[name] + error for name, error in self.errors.items()}
        return {**self._by_name, **wrong, **self.stuck}


def _places(devices: Sequence[Device], plant: Model) -> list[list[int]]:
    """For each device, the places of its inputs among the plant's."""
    wanted, driven = [v.name for v in plant.inputs], [name for device in devices for name in device.inputs]
    if sorted(wanted) != sorted(driven):
        takes, give = ", ".join(wanted) or "nothing", ", ".join(driven) or "nothing"
        raise PlantMismatchError(f"plant '{plant.name}' takes {takes}; the drives give {give}")
    names = [v.name for v in plant.outputs]
    missing = [name for device in devices for name in device.needs if name not in names]
    if missing:
        raise PlantMismatchError(f"plant '{plant.name}' has no output {', '.join(missing)}; it has {', '.join(names)}")
    return [[wanted.index(name) for name in device.inputs] for device in devices]


def _rates(plant: Model, tick_ns: int) -> tuple[int, int]:
    """Plant steps each time it is stepped, and ticks from one such time to the next."""
    step_ns = round(plant.step_size * _NS_PER_S)
    if tick_ns % step_ns == 0:
        return tick_ns // step_ns, 1
    if step_ns % tick_ns == 0:
        return 1, step_ns // tick_ns
    raise PlantMismatchError(
        f"the step of plant '{plant.name}', {plant.step_size} s, and the tick of the drives, {tick_ns * 1e-9} s, "
        "must divide one another"
    )
