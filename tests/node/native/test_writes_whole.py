# SPDX-License-Identifier: MIT
"""Writes from outside into machine code: tried, and applied whole or not at all; see `VariableWriter`."""

import mmap
import os
from pathlib import Path

import pytest

from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.models.load import load_model
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.watchdog.page import CallPage
from segway_ecc.node.watchdog.watched_model import watched
from tests.fixtures.tiny_fmu import make as tiny
from tests.fixtures.twenty_sim import models
from tests.fixtures.twenty_sim.maker import Maker

AREA, SETPOINT = r"Tank\area", r"Setpoint\C"


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def started(make: Maker, shape: str) -> NativeModel:
    model = load_model(str(getattr(make, shape)(models.TANK).path))
    assert isinstance(model, NativeModel)
    model.initialize([0.0])
    for _ in range(7):
        model.step([0.0])
    return model


@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_a_write_to_generated_code_is_whole_or_not_at_all(make: Maker, shape: str) -> None:
    model, other = started(make, shape), started(make, shape)
    writer = VariableWriter(model, declared_variables(model, {}, [AREA, SETPOINT]))
    before = model.save_state()

    assert "would be" in writer.write([(SETPOINT, 30.0), (AREA, 0.0)], [0.0], is_armed=True)
    assert model.save_state() == before
    assert writer.write([(SETPOINT, 30.0), (AREA, 4.0)], [0.0], is_armed=True) == ""
    other.write(SETPOINT, 30.0)
    other.write(AREA, 4.0)
    assert [model.step([0.0]) for _ in range(5)] == [other.step([0.0]) for _ in range(5)]


def test_an_fmu_takes_no_write_while_armed_and_any_other_while_not(make: Maker) -> None:
    model = started(make, "fmu")
    name = next(variable.name for variable in model.parameters if variable.name.endswith("C"))
    writer = VariableWriter(model, declared_variables(model, {}, [name]))
    refusal = writer.write([(name, 30.0)], [0.0], is_armed=True)
    assert refusal.startswith("a write that failed could not be taken back, so disarm the robot first: ModelError: ")
    assert writer.write([(name, 30.0)], [0.0]) == ""
    assert model.read(name) == 30.0


GAIN, SCALE, INPUT = "Controller.gain", "Plant.scale factor", [0.5]


def keeping(folder: Path, shape: tiny.Shape) -> NativeModel:
    """An FMU that gives and takes its state, some steps after its start."""
    capability = "canGetAndSetFMUState" if shape is tiny.Shape.FMI3 else "canGetAndSetFMUstate"
    interface = f'<CoSimulation modelIdentifier="tiny" {capability}="true"/>'
    changes = {"modelDescription.xml": tiny.description(shape, interface=interface)}
    model = load_model(str(tiny.packed(folder, shape, changes)))
    assert isinstance(model, NativeModel)
    model.initialize(INPUT)
    for _ in range(7):
        model.step(INPUT)
    return model


@pytest.mark.parametrize("shape", [tiny.Shape.OTHER, tiny.Shape.FMI3])
def test_an_fmu_that_keeps_its_state_takes_a_tunable_parameter_while_armed(tmp_path: Path, shape: tiny.Shape) -> None:
    model, other, untouched = (keeping(tmp_path, shape) for _ in range(3))
    writer = VariableWriter(model, declared_variables(model, {}, [GAIN]))
    assert "not tunable while the robot is armed" in writer.write([(SCALE, 2.0)], INPUT, is_armed=True)
    assert "would be" in writer.write([(GAIN, 1e308)], [1e308], is_armed=True)
    assert model.read(GAIN) == untouched.read(GAIN)
    assert writer.write([(GAIN, 3.0)], INPUT, is_armed=True) == ""
    other.write(GAIN, 3.0)
    assert [model.step(INPUT) for _ in range(5)] == [other.step(INPUT) for _ in range(5)]
    assert model.initialize(INPUT) == other.initialize(INPUT)


@pytest.mark.parametrize("shape", [tiny.Shape.OTHER, tiny.Shape.FMI3])
def test_a_refused_write_leaves_an_fmu_as_it_was(tmp_path: Path, shape: tiny.Shape) -> None:
    model, untouched = keeping(tmp_path, shape), keeping(tmp_path, shape)
    memory = os.memfd_create("calls")
    os.ftruncate(memory, mmap.PAGESIZE)
    writer = VariableWriter(watched(model, CallPage(memory, len(INPUT))), declared_variables(model, {}, [GAIN]))
    os.close(memory)
    assert "would be" in writer.write([(GAIN, 1e308)], [1e308], is_armed=True)
    assert [model.step(INPUT) for _ in range(5)] == [untouched.step(INPUT) for _ in range(5)]
    assert model.initialize(INPUT) == untouched.initialize(INPUT)
