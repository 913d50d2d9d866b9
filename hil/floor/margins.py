# SPDX-License-Identifier: MIT
"""The limits of a balancing robot against the friction of the floor, found by search on the plant whose wheels slip.

What disturbs a robot that stands is searched from where it stands: it gets up on a floor that grips, with its payload,
and the floor has its friction from `_FLOOR_AT_S` on. Whether it gets up at all has rows of its own.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.design.balance_margins import DisturbanceKind, Script, disturbances, find_limit, recovers
from segway_ecc.hil.floor.contact import on_floor, tyres
from segway_ecc.hil.floor.least_friction import rising_limit
from segway_ecc.hil.processes import quiet, results_of
from segway_ecc.hil.progress import OnProgress
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.models.segway_parameters import SegwayParameters

GRIP: Final = 1.2
"""What the floor has at least until the robot stands, 1."""
STAND_UP: Final = "stand-up"
_FLOOR_AT_S: Final = 3.5
_STOOD_UP_S: Final = 6.0
_LARGEST_FRICTION: Final = 1.5
_FRICTION_RESOLUTION: Final = 0.01
_LEFT_OUT: Final = "bias"
"""In the names of what does not depend on the floor."""


class FloorLimit(NamedTuple):
    """What was found of a disturbance on a floor.

    Attributes:
        name: Of the disturbance.
        unit: Of its size.
        friction: Of both tyres, 1; None where the limit is a friction itself.
        tolerated: The largest size tolerated with every seed; None where it falls without any.
        required: What it must tolerate; None where nothing is required.
        is_beyond: Whether all that was tried is tolerated.
        is_enough: Whether what is required is tolerated, or is beyond what the hardware can.
    """

    name: str
    unit: str
    friction: float | None
    tolerated: float | None
    required: float | None
    is_beyond: bool
    is_enough: bool


class Search(NamedTuple):
    """One search, as another process takes it."""

    robot: str
    body: SegwayParameters
    name: str
    friction: float | None
    seeds: Sequence[int]


def floor_kinds(p: SegwayParameters) -> Sequence[DisturbanceKind]:
    """The disturbances whose limits depend on the floor."""
    return [kind for kind in disturbances(p) if _LEFT_OUT not in kind.name]


def bumpers(p: SegwayParameters) -> Mapping[str, float]:
    """From which bumper it stands up, by the name of the row: the pitch at which it lies, rad."""
    return {f"{STAND_UP}, front bumper": p.stop_angle, f"{STAND_UP}, rear bumper": -p.stop_angle}


def find_floor_limits(searches: Sequence[Search], jobs: int, on_progress: OnProgress) -> list[FloorLimit]:
    """Make searches in so many processes; the limits are in their order, whatever `jobs` is.

    Raises:
        NoSimulationError: There is no plant with friction for this robot, or MuJoCo is not installed.
    """
    found: list[FloorLimit] = []
    with results_of(find, searches, jobs) as results:
        for limit in results:
            found.append(limit)
            on_progress(len(found), len(searches))
    return found


def searches_of(
    robot: str, body: SegwayParameters, frictions: Sequence[float], seeds: Sequence[int], only: str = ""
) -> Iterator[Search]:
    """All searches of a robot with this body whose names begin with `only`, on floors of these frictions."""
    for name in filter(lambda name: name.startswith(only), bumpers(body)):
        yield Search(robot, body, name, None, seeds)
        yield from (Search(robot, body, name, friction, seeds) for friction in frictions)
    for kind in filter(lambda kind: kind.name.startswith(only), floor_kinds(body)):
        yield from (Search(robot, body, kind.name, friction, seeds) for friction in frictions)


@quiet("segway_ecc.node")
def find(search: Search) -> FloorLimit:
    """Make one search."""
    file = on_floor(load_robot(search.robot))
    if search.name in bumpers(search.body):
        return _least_friction(file, search) if search.friction is None else _stand_up(file, search, search.friction)
    kind = next(kind for kind in floor_kinds(search.body) if kind.name == search.name)
    return _disturbed(file, kind, search)


def _disturbed(file: RobotFile, kind: DisturbanceKind, search: Search) -> FloorLimit:
    """The largest size of a disturbance that a robot on this floor recovers from with every seed."""
    friction, seeds = search.friction or 0.0, search.seeds
    there = on_friction(kind, friction, search.body)
    limit = find_limit(file, there, seeds)
    stands = limit.tolerated != 0.0 or all(recovers(file, there, 0.0, seed) for seed in seeds)
    is_enough = stands and limit.is_enough
    tolerated = limit.tolerated if stands else None
    return FloorLimit(kind.name, kind.unit, friction, tolerated, kind.required, limit.is_beyond, is_enough)


def on_friction(kind: DisturbanceKind, friction: float, body: SegwayParameters) -> DisturbanceKind:
    """A disturbance on a floor of this friction; see above."""

    def plant(size: float) -> Mapping[str, float]:
        return {**_lighter(kind.plant(size), body), **tyres(max(friction, GRIP))}

    def script(size: float) -> Script:
        return {_FLOOR_AT_S: _lay(friction), **kind.script(size)}

    return kind._replace(plant=plant, script=script)


def _lighter(plant: Mapping[str, float], body: SegwayParameters) -> Mapping[str, float]:
    """With a payload below zero at the body's centre as what it is: a lighter body. MuJoCo takes no such payload."""
    payload = plant.get("Payload", 0.0)
    return {"BodyMass": body.body_mass + payload} if payload < 0.0 else plant


def _lay(friction: float) -> Callable[[Balance], None]:
    def lay(balance: Balance) -> None:
        for name, value in tyres(friction).items():
            balance.plant.write(name, value)

    return lay


def _least_friction(file: RobotFile, search: Search) -> FloorLimit:
    """The least friction on which it stands up from a bumper; on any larger one it is taken to, too."""
    fails, stands = 0.0, _LARGEST_FRICTION
    can = _stand_up(file, search, stands).tolerated is not None
    while can and stands - fails > _FRICTION_RESOLUTION:
        middle = 0.5 * (fails + stands)
        if _stand_up(file, search, middle).tolerated is None:
            fails = middle
        else:
            stands = middle
    return FloorLimit(search.name, "1", None, stands if can else None, None, is_beyond=False, is_enough=can)


def _stand_up(file: RobotFile, search: Search, friction: float) -> FloorLimit:
    """Whether it stands up from a bumper on this floor with every seed: tolerated is 1, or None."""
    lies_at = bumpers(search.body)[search.name]
    kind = DisturbanceKind(search.name, "", 1.0, 1.0, 1.0, lambda _: tyres(friction), lambda _: {})
    stands = all(recovers(file, kind, 1.0, seed, lies_at=lies_at, duration_s=_STOOD_UP_S) for seed in search.seeds)
    is_enough = stands or friction < rising_limit(search.body).friction
    return FloorLimit(search.name, "", friction, 1.0 if stands else None, 1.0, is_beyond=False, is_enough=is_enough)
