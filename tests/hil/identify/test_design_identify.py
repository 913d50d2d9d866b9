# SPDX-License-Identifier: MIT
"""`design identify` from a log to a robot file: what the runs tell is in it, and what follows from that."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from segway_ecc.hil.design.balance import Balance
from segway_ecc.node.config import load_robot, read_text
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of

Run = Callable[..., Any]
TRUE = {"BodyMass": 6.2, "WheelRadius": 0.058, "Track": 0.26, "ImuHeight": 0.43}
"""Of the robot that is recorded; its file has the published ones."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot that begins upright, drives and turns."""
    file = load_robot("segway")
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    balance = Balance(file, pitch=0.0, plant=TRUE)
    written = CycleLog(path, layout_of(balance.robot), provenance_of(file, read_text("segway")))
    script = {
        1.0: lambda b: b.drive(0.4, 0.0),
        2.0: lambda b: b.drive(-0.4, 0.0),
        3.0: lambda b: b.drive(0.0, 1.5),
        4.0: lambda b: b.drive(0.0, -1.5),
    }
    balance.run(5.0, script, keep=written.write)
    written.close()
    return path


def test_it_finds_the_robot_and_writes_its_file(log: Path, tmp_path: Path, segway_ecc: Run) -> None:
    out = tmp_path / "mine.yaml"
    done = segway_ecc("design", "identify", str(log), "--out", str(out), "--no-advice", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)["quantities"]
    for name, value in TRUE.items():
        assert found[name]["found"] == pytest.approx(value, rel=0.05), name
        assert found[name]["least"] <= value <= found[name]["most"], name
        assert found[name]["origin"] == "found from the runs"
    assert found["ViscousFriction"]["origin"] == "hardly to be found from the runs"

    file, before = load_robot(str(out)), load_robot("segway")
    assert file.simulation is not None
    assert file.simulation.parameters["BodyMass"] == pytest.approx(found["BodyMass"]["found"], rel=1e-5)
    radius = file.simulation.parameters["WheelRadius"]
    assert file.model.parameters["WheelRadius"] == radius
    low, high = file.model.ranges["WheelRadius"]
    assert low is not None
    assert high is not None
    assert low < radius < high
    assert file.geometry.wheel_radius == radius
    assert file.safety is not None
    assert file.safety.gravity is not None
    assert file.safety.gravity.wheel_radius == radius
    residual = file.safety.residual
    assert residual is not None
    assert residual.moment == pytest.approx(found["BodyMass"]["found"] * found["BodyHeightOfCentre"]["found"], rel=1e-5)
    assert file.model.parameters["PitchGain"] != before.model.parameters["PitchGain"]
    kept = {name: getattr(before, name) for name in ("geometry", "model", "safety", "simulation")}
    assert structs.replace(file, **kept) == before
