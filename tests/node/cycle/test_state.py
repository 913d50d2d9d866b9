# SPDX-License-Identifier: MIT
"""The state of objects as plain data: everything that they hold, or a refusal that names what it is."""

import enum
import io
import itertools
import math
import struct
import threading
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

import segway_ecc.node.robots
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.firmware_io.value import Section
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of
from segway_ecc.node.config import NoHardwareSection, load_robot
from segway_ecc.node.cycle import state
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import FAILURES, Snapshot, capture, compare_snapshots, restore, restore_snapshot
from segway_ecc.node.model.attributes import attributes_of
from segway_ecc.node.robot import build_robot
from segway_ecc.testing import Bench

ROBOTS = sorted(path.stem for path in Path(segway_ecc.node.robots.__path__[0]).glob("*.yaml"))


class Colour(enum.Enum):
    RED = "red"


class Reading(NamedTuple):
    at: int
    setpoint: Setpoint


class Fields(msgspec.Struct, frozen=True):
    values: tuple[float, ...]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Frozen:
    value: float


class Settings(Section, frozen=True):
    key: int = 1


class Slotted:
    __slots__ = ("never", "value")

    def __init__(self, value: float) -> None:
        self.value = value


class Part:
    """Something of every kind that is known."""

    def __init__(self, number: float) -> None:
        self.plain = [None, True, 7, -(2**40), number, "text", b"bytes", math.inf, -0.0]
        self.pair = (number, [number, (1, number)])
        self.newest: deque[Any] = deque([number, Reading(1, Setpoint(number, 0.0))], maxlen=3)
        self.by_name: dict[Any, Any] = {"a": number, Colour.RED: [number]}
        self.counts = Counter({Colour.RED: int(number)})
        self.colour = Colour.RED
        self.reading = Reading(3, Setpoint(0.5, number))
        self.fields = Fields((number, 2.0))
        self.frozen = Frozen(number)
        self.inner = Slotted(number)
        self.again = self.inner
        self.owner = self
        self.both = (self.inner, Slotted(2 * number))
        self.settings = Settings()
        self.function = math.sin
        self.method = self.measure
        self._shared = self.plain

    def measure(self) -> float:
        return self.inner.value


def test_everything_comes_back_in_the_objects_that_are_there() -> None:
    one, two = Part(1.5), Part(9.0)
    one.newest.append(2.0)
    inner, newest = two.inner, two.newest
    data = capture(one)
    restore(two, data)

    assert capture(two) == data
    assert (two.inner, two.again, two.both[0], two.newest, two.owner) == (inner, inner, inner, newest, two)
    assert (inner.value, two.both[1].value) == (1.5, 3.0)
    assert two._shared is two.plain
    assert struct.pack("d", two.plain[-1]) == struct.pack("d", -0.0)
    assert (two.newest.maxlen, list(two.newest)) == (3, [1.5, Reading(1, Setpoint(1.5, 0.0)), 2.0])
    assert (two.reading.setpoint.angular_velocity, type(two.reading.setpoint)) == (1.5, Setpoint)
    assert (two.by_name, two.counts[Colour.RED]) == ({"a": 1.5, Colour.RED: [1.5]}, 1)
    assert (two.fields, two.frozen, two.colour) == (Fields((1.5, 2.0)), Frozen(1.5), Colour.RED)


class Number(float):
    """A number with something more to it."""


def closure() -> Callable[[], int]:
    count = 0

    def counting() -> int:
        nonlocal count
        count += 1
        return count

    return counting


UNKNOWN = {
    "set": {1},
    "bytearray": bytearray(3),
    "generator": (each for each in (1, 2)),
    "iterator": itertools.count(),
    "generator of numbers": np.random.default_rng(1),
    "drawing": np.random.default_rng(1).random,
    "method": Part(1.0).measure,
    "closure": closure(),
    "partial": partial(math.pow, 2.0),
    "lock": threading.Lock(),
    "array": np.zeros(3),
    "scalar": np.float64(1.0),
    "complex": 1j,
    "number": Number(1.0),
    "ordered": OrderedDict(a=1),
    "stream": io.StringIO(),
    "nothing": object(),
    "structure": struct.Struct("d"),
}


@pytest.mark.parametrize("value", UNKNOWN.values(), ids=UNKNOWN)
@pytest.mark.parametrize("inside", [lambda value: value, lambda value: [(value,)], lambda value: {"a": value}])
def test_what_is_of_no_known_kind_is_refused_with_its_attribute(value: object, inside: Callable[[Any], Any]) -> None:
    part = Part(1.0)
    part.inner.value = inside(value)

    with pytest.raises(TypeError, match=r"^Part\.\w+: Slotted\.value: \S+ cannot be captured$"):
        capture(part)


def test_what_is_too_much_is_refused() -> None:
    with pytest.raises(ValueError, match="there are more than 5000 values"):
        capture(Slotted([[0.0] * 100 for _ in range(101)]))  # type: ignore[arg-type] # any value
    with pytest.raises(OverflowError):
        capture(Slotted(2**70))


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_state_of_each_robot_is_captured_whole(robot: str) -> None:
    file, rig = load_robot(robot), LockstepRig(500_000)
    bare = isinstance(file.hardware, NoHardwareSection) or isinstance(file.hardware.line, CanSettings)
    built = build_robot(file, rig, None if bare else rig.ends(hardware_of(file)).node)
    loop = built.loop(NoStage(), NoRecorder())
    loop.run(20)
    taken = loop._cycle.take_state(20)

    assert taken.refusal == ""
    assert len(taken.parts) + len(taken.model) < 22_000  # of 60,000; the residual monitor takes 1,300
    restore_snapshot(loop._cycle, built.model, taken)
    assert loop._cycle.take_state(20) == taken


def test_a_new_attribute_of_an_unknown_kind_is_not_left_out(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    bench.loop.run(5)
    assert bench.cycle.take_state(5).parts
    bench.cycle._y = [{1}]  # type: ignore[list-item] # which is the point

    why = "Cycle._y: builtins:set cannot be captured"
    assert bench.cycle.take_state(5).refusal == f"the state of the cycle cannot be recorded: {why}"
    assert bench.cycle.take_state(5).parts == b""


def test_each_attribute_that_is_left_out_is_there(make_bench: Callable[..., Bench]) -> None:
    cycle = make_bench().cycle
    parts = (cycle, cycle.arming, cycle.trajectories, cycle._supervision)

    assert {name for part in parts for name in attributes_of(part)} >= state._OUTSIDE


def snapshot_of(part: Part) -> Snapshot:
    return Snapshot(0, 1, capture(part))


def test_what_differs_is_named() -> None:
    one, two = Part(1.0), Part(1.0)
    assert list(compare_snapshots(snapshot_of(one), snapshot_of(two))) == []
    two.both[1].value = math.nan
    two.colour = None  # type: ignore[assignment] # another kind
    two.newest.append(4.0)
    two.pair = (0.0, [1.0, (1, 1.0)])
    found = {
        path.removeprefix("state of the cycle."): values
        for path, *values in compare_snapshots(*map(snapshot_of, (one, two)))
    }

    assert found.pop("colour") == ["red", "None"]
    assert found == {
        "both[1].value": ["2.0", "nan"],
        "pair[0]": ["1.0", "0.0"],
        "newest": ["2 values", "3 values"],
        "newest[2]": ["nothing", "4.0"],
    }
    one.both[1].value = -math.nan
    assert "both[1].value" not in {
        path.rpartition("cycle.")[2] for path, *_ in compare_snapshots(snapshot_of(one), snapshot_of(two))
    }


def test_a_state_of_another_version_differs_and_is_not_put_back() -> None:
    one, two = Part(1.0), Part(1.0)
    two.more = 1.0  # type: ignore[attr-defined] # which is the point
    assert list(compare_snapshots(snapshot_of(one), snapshot_of(two))) == [
        ("state of the cycle.more", "nothing", "1.0")
    ]
    for taken, now in ((one, two), (two, one)):
        with pytest.raises(TypeError, match="test_state:Part has or had more"):
            restore(now, capture(taken))
    with pytest.raises(TypeError, match=r"test_state:Part was there, and now it is .*test_state:Slotted"):
        restore(Slotted(1.0), capture(one))


def named(path: str, content: object) -> bytes:
    return msgspec.msgpack.encode({f"{__name__}:Slotted": {"value": {path: content}}})


@pytest.mark.parametrize("path", ["os:system", "subprocess:Popen", "builtins:eval", "nowhere:X", "", ":", "os:"])
def test_nothing_but_values_is_made_by_name(path: str) -> None:
    with pytest.raises(FAILURES):
        restore(Slotted(1.0), named(path, {"a": 1}))


def test_any_flipped_byte_of_a_state_is_refused_or_gives_another_one() -> None:
    data, chance = capture(Part(1.0)), np.random.default_rng(4)
    outcomes = Counter[bool]()
    for _ in range(4000):
        flipped = bytearray(data)
        for _ in range(chance.integers(1, 5)):
            flipped[chance.integers(len(data))] = chance.integers(256)
        try:
            restore(Part(2.0), bytes(flipped))
        except FAILURES:
            outcomes[False] += 1
        else:
            outcomes[True] += 1
    assert min(outcomes.values()) > 100
