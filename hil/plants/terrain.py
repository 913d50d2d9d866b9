# SPDX-License-Identifier: MIT
"""The ground that a robot with contact drives on, as geometry for MuJoCo: a floor, and what lies on it.

Distances are along the x axis, m; the robot starts at 0. A slope everywhere is gravity that leans, not geometry.
Nothing ends sideways; what lies in the way of one wheel only is not there for the rest of the robot.
"""

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Final, NamedTuple, Self

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.models.segway_parameters import model_name

LEFT, RIGHT, FRONT, REAR = "left", "right", "front", "rear"
"""What touches the ground: the wheels, and the bumpers."""
_ALL: Final = (LEFT, RIGHT, FRONT, REAR)
_SIDES: Final = {1.0: (LEFT,), -1.0: (RIGHT,)}
_FAR: Final = 100.0
"""How far the ground goes in each direction, m."""
_DEEP: Final = 0.5
"""Half of how thick a piece of it is, m, so that nothing gets under it."""
_STONES_PER_M: Final = 60
_STONE_RADIUS: Final = 0.015
_STONE_TURN: Final = 0.6
"""How far a stone lies across the way at most, rad."""


def _length(value: float, minimum: float, maximum: float, text: str, unit: str = "m") -> float:
    made: float = field(
        default=value, metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "description": text}
    )
    return made


class Piece(NamedTuple):
    """A piece of ground: its attributes as a geom of MJCF, and what touches it."""

    shape: str
    touched_by: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terrain:
    """What lies on the floor, by default nothing; every field has its unit, its range and its meaning as metadata."""

    kerb_at: float = _length(1.0, 0.1, 50.0, "where a kerb or a board begins")
    kerb_height: float = _length(0.0, -0.2, 0.2, "how high it is; negative: by how much the floor drops there")
    kerb_length: float = _length(50.0, 0.01, 50.0, "how far it goes on: 0.2 is a board")
    kerb_side: float = _length(0.0, -1.0, 1.0, "0: in both wheels' way, 1: in the left one's, -1: the right one's", "1")
    gravel_at: float = _length(1.0, 0.1, 50.0, "where gravel begins")
    gravel_length: float = _length(0.0, 0.0, 5.0, "how far it goes on")
    gravel_height: float = _length(0.01, 0.001, 0.05, "of its highest stones")
    ice_at: float = _length(1.0, -50.0, 50.0, "where ice begins")
    ice_length: float = _length(0.0, 0.0, 50.0, "how far it goes on")
    ice_friction: float = _length(0.2, 0.01, 2.0, "of a tyre on it", "1")
    ramp_at: float = _length(1.0, 0.1, 50.0, "where a ramp begins")
    ramp_length: float = _length(0.0, 0.0, 20.0, "how far it goes, along the ground; behind it the floor is level")
    ramp_angle: float = _length(0.1, -0.5, 0.5, "its slope; negative is downhill", "rad")

    @classmethod
    def from_model(cls, values: Mapping[str, float]) -> Self:
        """Take the parameters of a model that declares `TERRAIN_VARIABLES`, by their names there.

        Raises:
            ModelError: A drop was asked for in the way of one wheel.
        """
        terrain = cls(**{f.name: values[model_name(f.name)] for f in fields(cls)})
        if terrain.kerb_height < 0.0 and terrain.kerb_side:
            raise ModelError("a drop (KerbHeight below 0) is in both wheels' way: set KerbSide to 0")
        return terrain

    @property
    def start_height(self) -> float:
        """Of the ground where the robot starts, m."""
        return max(0.0, -self.kerb_height)

    def friction(self, x: float, floor: float) -> float:
        """Of a tyre at a place, where it is `floor` on the floor."""
        return self.ice_friction if self.ice_at <= x < self.ice_at + self.ice_length else floor

    def pieces(self, seed: int) -> Iterator[Piece]:
        """The floor, then what lies on it; `seed` lays the gravel."""
        yield from self._floor()
        if self.kerb_height < 0.0:
            yield _block(-_FAR, self.kerb_at, self.start_height)
        elif self.kerb_height:
            end = self.kerb_at + self.kerb_length
            yield _block(self.kerb_at, end, self.kerb_height, _SIDES.get(self.kerb_side, _ALL))
        stones = random.Random(seed)  # noqa: S311 - gravel that can be laid again, no secret
        for wheel in (LEFT, RIGHT):
            for _ in range(round(_STONES_PER_M * self.gravel_length)):
                yield self._stone(wheel, stones)

    def _floor(self) -> Iterator[Piece]:
        angle, length = self.ramp_angle, self.ramp_length
        if not length:
            yield Piece('type="plane" size="0 0 1"', _ALL)
            return
        sin, cos = math.sin(angle), math.cos(angle)
        yield _block(-_FAR, self.ramp_at, 0.0)
        size = f"{0.5 * length} {_FAR} {_DEEP}"
        place = f"{self.ramp_at + 0.5 * length * cos + _DEEP * sin} 0 {0.5 * length * sin - _DEEP * cos}"
        yield Piece(f'type="box" size="{size}" pos="{place}" euler="0 {-angle} 0"', _ALL)
        yield _block(self.ramp_at + length * cos, _FAR, length * sin)

    def _stone(self, wheel: str, stones: random.Random) -> Piece:
        """A long stone that lies across the way, turned a little and of its own height."""
        x = self.gravel_at + stones.random() * self.gravel_length
        z = self.gravel_height * stones.uniform(0.2, 1.0) - _STONE_RADIUS
        turn = f"{math.pi / 2} {stones.uniform(-_STONE_TURN, _STONE_TURN)} 0"
        return Piece(f'type="capsule" size="{_STONE_RADIUS} 1" pos="{x} 0 {z}" euler="{turn}"', (wheel,))


def _block(begin: float, end: float, height: float, touched_by: tuple[str, ...] = _ALL) -> Piece:
    """A block whose top is at a height, m."""
    size = f"{0.5 * (end - begin)} {_FAR} {_DEEP}"
    return Piece(f'type="box" size="{size}" pos="{0.5 * (begin + end)} 0 {height - _DEEP}"', touched_by)


_LEVEL: Final = Terrain()
TERRAIN_VARIABLES: Final = tuple(
    Variable(
        model_name(f.name),
        f.metadata["unit"],
        getattr(_LEVEL, f.name),
        Write.RESET,
        f.metadata["description"],
        minimum=f.metadata["minimum"],
        maximum=f.metadata["maximum"],
    )
    for f in fields(Terrain)
)
"""The same as parameters of a plant: `kerb_at` is `KerbAt`."""
