# SPDX-License-Identifier: MIT
"""Limits against friction: the search over a robot that is made up, its table, and real runs to either side."""

from typing import Any

import pytest

from segway_ecc.hil.design import balance_margins
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.floor import margins
from segway_ecc.hil.floor.contact import has_contact, is_on_floor, on_floor
from segway_ecc.hil.floor.least_friction import rising_limit
from segway_ecc.hil.floor.margins import Search, find, searches_of
from segway_ecc.hil.floor.margins_report import beyond_hardware, draw, table
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED

FRICTIONS = (0.4, 0.6, 0.8)
STANDS_FROM = 0.55
"""The made-up robot stands up from there on; it tolerates a push of 100 N times the friction, and no slope."""


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def pretend(_file: object, kind: Any, size: float, seed: int, **_: float) -> bool:
        plant = dict(kind.plant(size))
        if kind.name.startswith("stand-up"):
            return bool(plant["LeftFriction"] >= STANDS_FROM)
        if kind.name.startswith("slope"):
            return False
        assert plant["LeftFriction"] >= 1.2, "it gets up on a floor that grips"
        floor: dict[str, float] = {}
        balance = type("Made", (), {"plant": type("Plant", (), {"write": lambda _, n, v: floor.update({n: v})})()})()
        kind.script(size)[3.5](balance)
        return abs(size) <= 100.0 * floor["RightFriction"] / seed

    monkeypatch.setattr(margins, "recovers", pretend)
    monkeypatch.setattr(balance_margins, "recovers", pretend)


def found(only: str) -> list[margins.FloorLimit]:
    return [find(search) for search in searches_of("segway", PUBLISHED, FRICTIONS, (1, 2), only)]


@pytest.mark.mujoco
@pytest.mark.usefixtures("made_up")
def test_a_limit_is_found_for_each_friction_and_the_worst_seed() -> None:
    tolerated = {limit.friction: limit.tolerated for limit in found("push back, 0.1 s")}
    assert tolerated == pytest.approx({0.4: -20.0, 0.6: -30.0, 0.8: -40.0}, abs=1.0)


@pytest.mark.mujoco
@pytest.mark.usefixtures("made_up")
def test_the_table_shows_what_is_required_and_not_met() -> None:
    head, front, rear, up, down = table([*found("stand-up"), *found("slope")], FRICTIONS)
    assert head == ("disturbance", "unit", "at 0.4", "at 0.6", "at 0.8", "required", "least friction")
    # Below 0.447 nothing could stand up, which is no fault of the controller.
    assert front == ("stand-up, front bumper", "", "no", "yes", "yes", "yes", "0.55")
    assert rear[2:5] == ("no", "yes", "yes")
    assert up == ("slope, up", "rad", "falls !", "falls !", "falls !", "0.0873", "")
    assert down[0] == "slope, down"


@pytest.mark.mujoco
@pytest.mark.usefixtures("made_up")
def test_the_figure_is_drawn() -> None:
    pytest.importorskip("matplotlib")
    files = draw([*found("stand-up"), *found("push")], 0.447, "a title")
    assert files["margins.png"].startswith(b"\x89PNG")


def test_what_is_beyond_the_hardware_is_stated_with_its_torque() -> None:
    assert beyond_hardware(rising_limit(PUBLISHED), 1.7) == (
        "beyond the hardware: on a friction below 0.447 no torque raises it from its bumper; "
        "there it takes 0.60 N m of each wheel, of 1.70 N m, which it has"
    )
    assert beyond_hardware(rising_limit(PUBLISHED), 0.5).endswith("WHICH IT HAS NOT")


def test_only_a_segways_plant_is_put_on_a_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    assert has_contact(load_robot("segway-odrive"))
    assert not is_on_floor(load_robot("segway"))
    with pytest.raises(NoSimulationError, match="no plant with friction"):
        on_floor(load_robot("cart-can"))
    monkeypatch.setattr("segway_ecc.hil.floor.contact.lacks_mujoco", lambda: "pip install it")
    with pytest.raises(NoSimulationError, match="needs MuJoCo: pip install it"):
        on_floor(load_robot("segway"))


@pytest.mark.mujoco
@pytest.mark.variants(1)
@pytest.mark.parametrize(("friction", "expected"), [(0.4, None), (0.8, 1.0)])
def test_the_packaged_robot_stands_up_or_not(friction: float, expected: float | None) -> None:
    assert find(Search("segway", PUBLISHED, "stand-up, front bumper", friction, (1,))).tolerated == expected


def test_a_payload_below_zero_is_a_lighter_body_that_gets_up_where_it_grips() -> None:
    more, less = (k for k in margins.floor_kinds(PUBLISHED) if k.name.startswith("payload"))
    lighter = margins.on_friction(less, 0.6, PUBLISHED).plant(-2.0)
    assert lighter == {"BodyMass": pytest.approx(PUBLISHED.body_mass - 2.0), "LeftFriction": 1.2, "RightFriction": 1.2}
    assert margins.on_friction(more, 0.6, PUBLISHED).plant(2.0)["Payload"] == 2.0
