# SPDX-License-Identifier: MIT
import sys
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.models.cart import Cart
from segway_ecc.node.models.load import load_model


def test_loads_the_class_that_is_named() -> None:
    assert type(load_model("segway_ecc.node.models.cart:Cart")) is Cart


def test_parameters_reach_the_model() -> None:
    assert load_model("segway_ecc.node.models.cart:Cart", {"Track": 0.5}).read("Track") == 0.5


@pytest.mark.parametrize(
    "source",
    [
        "",
        "segway_ecc.node.models.cart",
        "segway_ecc.node.models.cart.Cart",
        ":Cart",
        "segway_ecc.node.models.cart:",
        pytest.param("n" * 5000, id="longer than a path"),
    ],
)
def test_a_source_that_is_not_module_and_class_is_refused(source: str) -> None:
    with pytest.raises(ModelError, match=rf"^'{source}' names no model: write package.module:Class$"):
        load_model(source)


def test_a_module_that_is_not_there_is_named() -> None:
    text = "^cannot load model 'segway_ecc.node.models.boat:Boat': No module named 'segway_ecc.node.models.boat'$"
    with pytest.raises(ModelError, match=text):
        load_model("segway_ecc.node.models.boat:Boat")


def test_a_package_that_is_not_there_is_named() -> None:
    with pytest.raises(ModelError, match=r"^cannot load model 'boats.fast:Boat': No module named 'boats'$"):
        load_model("boats.fast:Boat")


def test_a_class_that_is_not_there_is_named() -> None:
    text = (
        "^cannot load model 'segway_ecc.node.models.cart:Boat': module segway_ecc.node.models.cart has no class Boat$"
    )
    with pytest.raises(ModelError, match=text):
        load_model("segway_ecc.node.models.cart:Boat")


def test_a_parameter_that_the_model_lacks_is_refused_with_those_it_has() -> None:
    text = "^no parameter of model 'cart' is called 'Mass'; there is Resistance, .*, AssumedTrack$"
    with pytest.raises(UnknownNameError, match=text):
        load_model("segway_ecc.node.models.cart:Cart", {"Mass": 1.0})


def test_what_is_named_but_is_no_class_is_refused() -> None:
    with pytest.raises(ModelError, match=r"module segway_ecc.node.models.cart has no class STEP_SIZE$"):
        load_model("segway_ecc.node.models.cart:STEP_SIZE")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("raise SystemExit(0)", "SystemExit: 0"),
        ("class Tank:\n    def __init__(self, parameters):\n        exit(0)", "SystemExit: 0"),
    ],
)
def test_whatever_a_model_raises_when_it_is_loaded_is_the_reason(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "raising_tank.py").write_text(text, "utf-8")
    try:
        with pytest.raises(ModelError, match=rf"^cannot load model '.*raising_tank:Tank': {reason} \(.+:\d+\)$"):
            load_model(f"{tmp_path}/raising_tank:Tank")
    finally:
        sys.modules.pop("raising_tank", None)
