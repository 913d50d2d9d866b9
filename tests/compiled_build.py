# SPDX-License-Identifier: MIT
"""What is installed is compiled. Run by `make test-compiled` only, and so not called test_something."""

import dataclasses
import importlib
import math
import struct
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from segway_ecc.drives import PhasedDrive
from segway_ecc.firmware_io.devices import Readings
from segway_ecc.firmware_io.drives.wheel_board.frames import Wheel
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.value import Value
from segway_ecc.hil.plants.segway_hardware import Encoder
from segway_ecc.node.cycle import cycle
from segway_ecc.node.models.segway_estimate import Estimate
from segway_ecc.node.models.segway_law import PhaseProgress
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.limiter import limit, not_finite
from tests.compiled_modules import COMPILED


def test_the_cycle_is_compiled() -> None:
    assert cycle.__file__.endswith(".so")


@pytest.mark.parametrize("path", COMPILED)
def test_a_module_is_compiled_and_its_source_is_there(path: str) -> None:
    module = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    assert module.__file__ is not None
    assert module.__file__.endswith(tuple(EXTENSION_SUFFIXES))
    assert (Path(module.__file__).parent / Path(path).name).is_file()


@pytest.mark.parametrize("kind", [Frame, Readings, Wheel, Estimate, PhaseProgress])
def test_a_value_cannot_be_changed_and_is_no_business_of_the_collector(kind: type[Value]) -> None:
    """mypyc drops the options of a class; those of its base stay."""
    assert (kind.__struct_config__.frozen, kind.__struct_config__.gc) == (True, False)


class OwnDrive(PhasedDrive):
    """A drive of a user's own, in plain Python."""

    def __init__(self) -> None:
        super().__init__(lambda: 5)
        self.torque = 0.0


def test_a_drive_in_plain_python_builds_on_what_is_compiled() -> None:
    drive = OwnDrive()
    assert (drive.is_enabled, drive.torque) == (False, 0.0)
    drive._enabling.begin(drive._now_ns())
    drive._enabling.confirm()
    assert drive.is_enabled


@pytest.mark.parametrize("value", [-113.0, -0.0, 0.0, math.nan, math.inf, -math.inf, 113, np.float64(-113.0)])
@pytest.mark.parametrize("bound", [0.5, 113.0, 200])
def test_a_command_is_limited_as_python_does_it(value: float, bound: float) -> None:
    """mypyc marks a missing float with -113.0, and takes whole numbers and numpy's where floats are declared."""
    limited = limit([value], [bound])[0]
    assert struct.pack("d", limited) == struct.pack("d", min(max(value, -bound), bound))
    assert not_finite([value]) == (None if math.isfinite(value) else 0)


@pytest.mark.parametrize("value", ["1.0", None, b"1"])
def test_what_is_no_number_is_refused(value: Any) -> None:
    with pytest.raises(TypeError):
        not_finite([value])
    with pytest.raises(TypeError):
        limit([value], [1.0])


def test_an_angle_is_an_angle_also_where_it_is_the_mark() -> None:
    encoder = Encoder(dataclasses.replace(PUBLISHED, encoder_counts_per_turn=0.0), 0.001, -113.0)
    encoder.follow(-113.0, -113.0, -113.0, -113.0, 1)
    assert (encoder.angle, encoder.velocity) == (-113.0, -113.0)
