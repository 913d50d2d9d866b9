# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

import segway_ecc.node.models
from segway_ecc.hil.bench.speed import step_cost
from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.load import load_native

CART = Path(segway_ecc.node.models.__file__).with_name("cart_submodel")
pytestmark = pytest.mark.compiler


def test_both_sides_are_measured_and_ours_has_c_in_it() -> None:
    cost = step_cost(load_native(CART))
    assert 0.0 < cost["native_s"] < cost["through_our_interface_s"]


def test_a_failing_c_program_is_reported(tmp_path: Path) -> None:
    model = load_native(CART)
    model.library_path = tmp_path / "gone.so"
    with pytest.raises(ModelError, match=r"^cannot measure model 'Cart' from C: "):
        step_cost(model)
