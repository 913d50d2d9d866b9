# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings
from segway_ecc.node.config import RobotFile, decode_robot
from segway_ecc.node.errors import ConfigurationError

FILE = """
name: bench
model: {{source: m}}
wiring: {{}}
hardware:
  type: hoverboard
  serial: {{port: /dev/bench}}
  {more}
  left: {{torque_constant: 0.25, max_torque: 3.0}}
  right: {{torque_constant: 0.25, max_torque: 3.0}}
"""


def decode(more: str = "serial_timeout_cycles: 160") -> RobotFile:
    return decode_robot(FILE.format(more=more), "bench.yaml")


def test_a_robot_file_names_the_line_and_what_was_compiled_in() -> None:
    hardware = decode().hardware
    assert isinstance(hardware, HoverboardSettings)
    assert (hardware.line.port, hardware.line.baudrate) == ("/dev/bench", 115_200)
    assert hardware.guard == "required"
    assert hardware.timeout_s == pytest.approx(0.815, abs=0.001)
    assert family_of(hardware).watchdog(hardware).timeout_s == hardware.timeout_s


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("max_current: 15.0", "missing required field `serial_timeout_cycles`"),
        ("{serial_timeout_cycles: 160, can: {}}", "can"),
        ("serial_timeout_cycles: 160\n  max_current: 10.0", "max_torque 3 N m is more than the 2.5 N m"),
        ("serial_timeout_cycles: 160\n  watchdog_s: 0.03", "takes no watchdog_s"),
    ],
)
def test_what_does_not_fit_the_firmware_is_refused(more: str, text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        decode(more)
