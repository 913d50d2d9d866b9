# SPDX-License-Identifier: MIT
import json
from collections.abc import Callable
from typing import Any

Run = Callable[..., Any]


def test_json_has_what_there_is_to_know_of_a_model(segway_ecc: Run) -> None:
    found = json.loads(segway_ecc("model", "inspect", "segway_ecc.node.models.cart:CartController", "--json").out)
    assert {key: found[key] for key in ("name", "flavour", "method", "step_size_s", "finish_time_s", "warnings")} == {
        "name": "cart-controller",
        "flavour": "python",
        "method": "RungeKutta4",
        "step_size_s": 0.01,
        "finish_time_s": None,
        "warnings": [],
    }
    assert found["inputs"] == [
        {"name": "LeftVelocity", "unit": "rad/s", "value": 0.0, "write": "now"},
        {"name": "RightVelocity", "unit": "rad/s", "value": 0.0, "write": "now"},
    ]
    track = {"name": "Track", "unit": "m", "value": 0.3, "write": "static", "minimum": 0.02, "maximum": 5.0}
    assert track in found["parameters"]
    assumed = {**track, "name": "AssumedTrack", "value": 0.300522, "tunable": True}
    assert assumed in found["parameters"]
    assert {"name": "LinearSetpoint", "unit": "m/s", "value": 0.0, "write": "now"} in found["states"]
    assert {"name": "PoseX", "unit": "m", "value": 0.0, "write": "never"} in found["states"]
    assert {"name": "LeftVoltage", "unit": "V", "value": 0.0, "write": "never"} in found["outputs"]


def test_people_read_when_a_write_takes_effect(segway_ecc: Run) -> None:
    lines = [
        " ".join(line.split())
        for line in segway_ecc("model", "inspect", "segway_ecc.node.models.cart:Cart").out.splitlines()
    ]
    assert "inputs: none" in lines
    assert "Track 0.3 m a write takes effect at once, through the static equations; 0.02 to 5 m" in lines
    assert any(line.startswith("FeedbackGain") and line.endswith("0 to 10 V s; tunable while armed") for line in lines)
    assert "LinearSetpoint 0 m/s a write takes effect at once" in lines
    assert "LeftCurrent 0 A cannot be written" in lines


def test_missing_model_is_reported_in_one_line(segway_ecc: Run) -> None:
    outcome = segway_ecc("model", "inspect", "nowhere:Model")
    assert outcome.code == 3
    (line,) = outcome.errors
    assert line == "segway-ecc: cannot load model 'nowhere:Model': No module named 'nowhere'"
