# SPDX-License-Identifier: MIT
import re
from typing import Any

import msgspec
import pytest
import yaml

from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.node.config import load_robot, read_text
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError


def decode(hardware: dict[str, Any]) -> Cia402Settings:
    return decode_yaml(yaml.safe_dump({"type": "cia402", **hardware}), Cia402Settings, "test")


def hardware() -> dict[str, Any]:
    wheel = {"node_id": 1, "counts_per_turn": 4096, "max_torque": 2.0}
    return {"axes": {"left": wheel, "right": {**wheel, "node_id": 2}}}


def test_the_packaged_robot_is_read() -> None:
    found = load_robot("cart-cia402").hardware
    assert isinstance(found, Cia402Settings)
    assert ([wheel.node_id for wheel in found.axes.values()], found.host_node_id) == ([1, 2], 127)
    assert "cia402" in read_text("cart-cia402")


def test_what_is_left_out_has_its_default() -> None:
    settings = decode(hardware())
    left = settings.axes["left"]
    assert settings.host_node_id == 127
    assert settings.watchdog_s == 0.05
    assert (left.gear_ratio, left.direction) == (1.0, 1)
    assert left.velocity_unit_turns == pytest.approx(1 / 4096)


def test_a_velocity_in_rpm_is_sixty_at_one_turn_a_second() -> None:
    document = hardware()
    document["axes"]["left"] = {**document["axes"]["left"], "velocity_units_per_turn": 60}
    assert decode(document).axes["left"].velocity_unit_turns == pytest.approx(1 / 60)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("axes", "left", "node_id"), 0, ">= 1"),
        (("axes", "left", "node_id"), 128, "<= 127"),
        (("axes", "left", "counts_per_turn"), 0, ">= 1"),
        (("axes", "left", "counts_per_turn"), 2**24 + 1, "<= 16777216"),
        (("axes", "left", "velocity_units_per_turn"), 0.0, "> 0.0"),
        (("axes", "left", "max_torque"), -1.0, "> 0.0"),
        (("axes", "left", "spare"), 1, "spare"),
        (("axes", "left", "node_id"), 2, "left and right have the same node_id, 2"),
        (("axes", "left", "node_id"), 127, "host_node_id is 127, which is a drive's"),
        (("host_node_id",), 2, "host_node_id is 2, which is a drive's"),
        (("axes", "supply"), {"node_id": 3, "counts_per_turn": 1, "max_torque": 1.0}, "no axis can be called 'supply'"),
        (("host_node_id",), 0, ">= 1"),
        (("watchdog_s",), 0.06, "<= 0.05"),
        (("watchdog_s",), 0.01, ">= 0.02"),
        (("serial",), {"port": "/dev/null"}, "serial"),
    ],
)
def test_what_cannot_be_is_refused(path: tuple[str, ...], value: object, message: str) -> None:
    document = msgspec.to_builtins(hardware())
    document["axes"]["left"] = dict(document["axes"]["left"])
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        decode(document)
