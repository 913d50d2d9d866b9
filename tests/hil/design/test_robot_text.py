# SPDX-License-Identifier: MIT
"""Tests of a robot file's text with other parameters."""

import pytest

from segway_ecc.hil.design.robot_text import with_parameters
from segway_ecc.node.config import load_robot, read_text
from segway_ecc.node.errors import ConfigurationError


def test_the_packaged_file_written_anew_is_itself() -> None:
    text = read_text("segway")
    assert with_parameters(text, "model", load_robot("segway").model.parameters) == text


def test_other_parameters_and_comments_stay() -> None:
    text = "name: x\nmodel: # mine\n  source: a:B\n\n# hardware\nwiring: {}\n"
    changed = with_parameters(text, "model", {"MaxSpeed": 1.0})
    assert "model: # mine\n  source: a:B\n" in changed
    assert "# hardware\nwiring: {}\n" in changed
    assert with_parameters(changed, "model", {"MaxSpeed": 2.0}) == changed.replace("1.0", "2.0")


@pytest.mark.parametrize(
    "text",
    ["name: x\nmodel: {source: 'a:B'}\nwiring: {}\n", "name: x\nmodel:\n    source: a:B\nwiring: {}\n"],
    ids=["flow", "deeper"],
)
def test_a_file_laid_out_otherwise_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        with_parameters(text, "model", {"MaxSpeed": 1.0})


def test_a_plant_without_parameters_gets_a_block_of_them() -> None:
    text = "name: x\nwiring: {}\nmodel:\n  source: a:B\nsimulation:\n  plant: a:P"
    changed = with_parameters(text, "simulation", {"BodyMass": 5.0})
    assert changed == f"{text}\n  parameters:\n    BodyMass: 5.0\n"


def test_a_file_without_the_block_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no block `simulation:`"):
        with_parameters("name: x\nwiring: {}\nmodel:\n  source: a:B\n", "simulation", {"BodyMass": 5.0})
