# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest
from msgspec import structs

from segway_ecc.firmware_io.build import can_link
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.plants.cart import CartPlant
from segway_ecc.hil.rig.fronts import FaultyLink, PacedLink
from segway_ecc.hil.rig.simulation import hardware_of, simulated_plant, simulated_robot
from segway_ecc.node.config import SimulationSection, load_robot
from segway_ecc.node.errors import ModelError

CAN = CanSettings(interface="virtual", channel="bench", bitrate=250_000)


def test_the_bus_is_the_robots_own() -> None:
    file = structs.replace(load_robot("cart-can"), hardware=WheelBoardSettings(can=CAN))
    assert hardware_of(file).line == CAN


def test_a_robot_that_is_all_model_has_no_bus() -> None:
    with pytest.raises(NoSimulationError, match=r"^robot 'cart' has no hardware that could be simulated"):
        hardware_of(load_robot("cart"))


def test_the_plant_is_the_one_that_the_file_names() -> None:
    assert type(simulated_plant(load_robot("cart-can"))) is CartPlant


def test_the_plant_has_the_parameters_that_the_file_names() -> None:
    file = load_robot("segway")
    assert file.simulation is not None
    simulation = structs.replace(file.simulation, parameters={"BodyMass": 12.0})
    assert simulated_plant(structs.replace(file, simulation=simulation)).read("BodyMass") == 12.0


def test_a_robot_without_a_plant_is_refused_with_the_key_to_add() -> None:
    file = structs.replace(load_robot("cart-can"), simulation=None)
    with pytest.raises(NoSimulationError, match=r"^robot 'cart-can' has no plant: add simulation\.plant to its file$"):
        simulated_plant(file)


def test_a_plant_that_is_not_there_is_named() -> None:
    file = structs.replace(
        load_robot("cart-can"), simulation=SimulationSection(plant="segway_ecc.hil.plants.cart:Boat")
    )
    with pytest.raises(ModelError, match=r"hil\.plants\.cart:Boat"):
        simulated_plant(file)


@pytest.mark.parametrize("front", [lambda link: link, PacedLink, lambda link: FaultyLink(PacedLink(link))])
def test_devices_can_be_asked_by_remote_frame_whatever_stands_in_front_of_their_bus(
    front: Callable[[Link], Link],
) -> None:
    bus = can_link(CAN, RealClock())
    assert isinstance(bus, CanLink)
    assert not bus.receives_remote
    simulated_robot(load_robot("cart-can"), front(bus))
    assert bus.receives_remote
