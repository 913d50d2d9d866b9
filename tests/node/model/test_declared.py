# SPDX-License-Identifier: MIT
"""What a robot file declares of a model's variables."""

import re

import pytest

from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.declared import Range, declared_variables
from segway_ecc.node.models.cart import Cart


def test_a_variable_is_as_the_model_declares_it_until_the_robot_file_narrows_it() -> None:
    found = declared_variables(Cart(), {"Track": (None, 0.6), "LinearSetpoint": (-1.0, 1.0)}, ["Friction"])
    assert (found["Track"].minimum, found["Track"].maximum) == (0.02, 0.6)
    assert (found["LinearSetpoint"].minimum, found["LinearSetpoint"].maximum) == (-1.0, 1.0)
    tunable = {name for name, variable in found.items() if variable.tunable}
    assert tunable == {"Friction", "FeedbackGain", "AssumedTrack"}


@pytest.mark.parametrize(
    ("ranges", "text"),
    [
        (
            {"Track": (0.01, 1.0)},
            "model.ranges: [0.01, 1] is no range of 'Track', which the model allows to be 0.02 to 5 m",
        ),
        ({"Track": (0.4, 0.2)}, "model.ranges: [0.4, 0.2] is no range of 'Track'"),
        ({"Track": (float("nan"), 1.0)}, "model.ranges: [nan, 1] is no range of 'Track'"),
        ({"Track": (0.4, 0.6)}, "model.parameters: 'Track' cannot be 0.3: allowed is 0.4 to 0.6 m"),
    ],
)
def test_a_range_that_cannot_be_is_refused(ranges: dict[str, Range], text: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        declared_variables(Cart(), ranges)


def test_names_that_the_model_lacks_are_refused() -> None:
    with pytest.raises(
        UnknownNameError, match=r"^no input, state or parameter of model 'cart' \(model.ranges\) is called"
    ):
        declared_variables(Cart(), {"Trakc": (0.1, 1.0)})
    with pytest.raises(UnknownNameError, match=r"\(model.tunable_while_armed\) is called 'Trakc'"):
        declared_variables(Cart(), {}, ["Trakc"])


def test_what_is_never_written_cannot_be_tunable() -> None:
    with pytest.raises(ConfigurationError, match=r"^model.tunable_while_armed: 'PoseX' cannot be written: "):
        declared_variables(Cart(), {}, ["PoseX"])
