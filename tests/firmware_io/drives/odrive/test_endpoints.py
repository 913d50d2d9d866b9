# SPDX-License-Identifier: MIT
"""The section of a robot file that is made from ODrive's `flat_endpoints.json`."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.endpoints import EndpointsError, endpoints_of, main, section_of
from segway_ecc.firmware_io.drives.odrive.settings import OdriveEndpoints, OdriveSettings
from segway_ecc.node.config import decode_robot

LIMIT, RESISTOR = "axis0.controller.config.vel_limit", "config.brake_resistor0.enable"
DOCUMENT: dict[str, Any] = {
    "fw_version": "0.6.10",
    "hw_version": "4.4.58",
    "endpoints": {
        "vbus_voltage": {"id": 1, "type": "float"},
        RESISTOR: {"id": 150, "type": "bool"},
        LIMIT: {"id": 388, "type": "float"},
        "save_configuration": {"id": 600, "type": "function", "inputs": [], "outputs": []},
    },
}
EXPECTED = OdriveEndpoints(firmware="0.6.10", hardware="4.4.58", ids={LIMIT: 388, RESISTOR: 150})
ROBOT = """
name: bench
model: {{source: "segway_ecc.node.models.cart:CartController"}}
wiring: {{}}
hardware:
  type: odrive
  firmware: "0.6"
{section}  axes:
    left: {{node_id: 0, max_torque: 1.0}}
"""


def changed(**changes: Any) -> bytes:
    return msgspec.json.encode(DOCUMENT | changes)


def test_what_is_compared_is_picked_whatever_else_there_is() -> None:
    assert endpoints_of(changed()) == EXPECTED


def test_the_section_is_what_a_robot_file_takes() -> None:
    hardware = decode_robot(ROBOT.format(section=section_of(EXPECTED)), "robot.yaml").hardware
    assert isinstance(hardware, OdriveSettings)
    assert hardware.endpoints == EXPECTED


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no flat_endpoints.json"),
        (b"[]", "no flat_endpoints.json"),
        (b"\xff", "no flat_endpoints.json"),
        (changed(fw_version="0.6"), "no flat_endpoints.json .*regex"),
        (changed(hw_version=4), "no flat_endpoints.json"),
        (changed(endpoints={"vbus_voltage": {"id": 1, "type": "float"}}), "length >= 1"),
        (changed(endpoints={LIMIT: {"id": 0, "type": "float"}}), ">= 1"),
        (changed(endpoints={LIMIT: {"id": 65_536, "type": "float"}}), "<= 65535"),
        (changed(endpoints={LIMIT: {"id": "388", "type": "float"}}), "no flat_endpoints.json"),
        (changed(endpoints={LIMIT: {"id": 388, "type": "uint8"}}), "vel_limit is of type 'uint8', read as float"),
        (changed(endpoints={RESISTOR: {"id": 388, "type": "float"}}), "enable is of type 'float', read as bool"),
    ],
)
def test_another_document_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(EndpointsError, match=message):
        endpoints_of(data)


def test_the_command_prints_the_section(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "flat_endpoints.json"
    file.write_bytes(changed())
    assert main([str(file)]) == 0
    assert capsys.readouterr().out == section_of(EXPECTED)


@pytest.mark.parametrize(("data", "message"), [(None, "No such file"), (b"{}", "no flat_endpoints.json")])
def test_the_command_reports_what_is_wrong_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], data: bytes | None, message: str
) -> None:
    file = tmp_path / "flat_endpoints.json"
    if data is not None:
        file.write_bytes(data)
    assert main([str(file)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
