# SPDX-License-Identifier: MIT
import csv
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from matplotlib.figure import Figure
from mcap.reader import make_reader

from tests.drawn_texts import bare_axes, hard_numbers, overlapping, texts_of

Run = Callable[..., Any]
CONTROLLER = "segway_ecc.node.models.cart:CartController"


def test_held_inputs_lead_where_the_equations_say(segway_ecc: Run) -> None:
    words = (
        "model",
        "simulate",
        CONTROLLER,
        "--input",
        "LeftVelocity=20",
        "--input",
        "RightVelocity=20",
        "--duration",
        "2",
    )
    result = json.loads(segway_ecc(*words, "--json").out)
    # Wheels of 0.05 m at 20 rad/s for 2 s; the set-point is zero, so each volt is the feedback's: -0.0935464 * 20.
    assert result["time_s"] == 2.0
    assert result["outputs"]["X"] == pytest.approx(2.0)
    assert result["outputs"]["LeftVoltage"] == pytest.approx(-1.870928)


def test_a_parameter_that_is_set_holds_from_the_start(segway_ecc: Run) -> None:
    words = (
        "model",
        "simulate",
        CONTROLLER,
        "--input",
        "LeftVelocity=20",
        "--input",
        "RightVelocity=20",
        "--duration",
        "2",
    )
    result = json.loads(segway_ecc(*words, "--set", "WheelRadius=0.1", "--json").out)
    assert result["outputs"]["X"] == pytest.approx(4.0)


def test_the_table_has_units(segway_ecc: Run) -> None:
    lines = segway_ecc("model", "simulate", CONTROLLER, "--duration", "0.1").out.splitlines()
    assert lines[0].split() == ["time", "0.1", "s"]
    assert lines[1].split() == ["X", "0", "m"]


def test_every_sample_goes_to_the_files(segway_ecc: Run, tmp_path: Path) -> None:
    files = {option: tmp_path / f"out.{option}" for option in ("csv", "mcap")} | {"plot": tmp_path / "out.svg"}
    words = [word for option, path in files.items() for word in (f"--{option}", str(path))]
    assert (
        segway_ecc("model", "simulate", CONTROLLER, "--input", "LeftVelocity=1", "--duration", "0.5", *words).code == 0
    )

    rows = list(csv.reader(files["csv"].read_text().splitlines()))
    assert rows[0][:4] == ["time", "LeftVelocity", "RightVelocity", "X"]
    assert len(rows) == 1 + 51
    assert float(rows[-1][0]) == 0.5
    with files["mcap"].open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 51 * 9
    assert ET.fromstring(files["plot"].read_text()).tag.endswith("svg")  # noqa: S314 - we drew it a moment ago


def test_outputs_of_one_unit_are_drawn_together(segway_ecc: Run, tmp_path: Path, drawn: list[Figure]) -> None:
    words = (
        "model",
        "simulate",
        "segway_ecc.hil.plants.cart:CartPlant",
        "--duration",
        "1",
        "--input",
        "left.voltage=5",
    )
    assert segway_ecc(*words, "--plot", str(tmp_path / "out.png")).code == 0
    (figure,) = drawn
    texts = texts_of(figure)
    assert sorted(axes.get_ylabel() for axes in figure.axes) == ["m", "m/s", "m/s2", "rad", "rad/s"]
    assert {"left.velocity", "imu.angular_velocity_z"} <= {text.text for text in texts}
    assert any("right.velocity 0 rad/s" in text.text for text in texts)
    assert bare_axes(figure) == []
    assert overlapping(texts) == []
    assert hard_numbers([text.text for text in texts]) == []


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (("--duration", "0"), 2, "--duration must be more than 0 s and at most 86400 s"),
        (("--duration", "inf"), 2, "argument --duration: inf is not finite"),
        (("--duration", "0.0004"), 2, "--duration is 0.0004 s, less than a step of 0.01 s"),
        (("--duration", "1_0"), 2, "argument --duration: invalid float value: '1_0'"),
        (("--duration", "\u0661"), 2, "argument --duration: invalid float value: '\u0661'"),
        (("--duration", "1", "--set", "Track=1_0"), 2, "--set wants NAME=VALUE with a number"),
        (("--duration", "1", "--set", "Track=1", "--set", "Track=2"), 2, "--set names 'Track' twice"),
        (("--duration", "1", "--input", "a=1", "--input", "a=1"), 2, "--input names 'a' twice"),
        (("--duration", "1", "--input", "LeftVelocity"), 2, "--input wants NAME=VALUE with a number"),
        (("--duration", "1", "--set", "Track=wide"), 2, "--set wants NAME=VALUE with a number"),
        (("--duration", "1", "--input", "Left=1"), 3, "there is LeftVelocity, RightVelocity"),
        (("--duration", "1", "--set", "Width=1"), 3, "no parameter of model 'cart-controller' is called 'Width'"),
        (("--duration", "1", "--csv", "/nowhere/out.csv"), 2, "cannot write /nowhere/out.csv"),
        (("--duration", "1", "--plot", "/nowhere/out.svg"), 2, "cannot write /nowhere/out.svg"),
    ],
)
def test_a_mistake_is_told_in_one_line(segway_ecc: Run, words: tuple[str, ...], code: int, text: str) -> None:
    outcome = segway_ecc("model", "simulate", CONTROLLER, *words)
    assert outcome.code == code
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: ")
    assert text in line


def test_a_simulation_that_is_not_kept_takes_no_more_memory_the_longer_it_lasts(segway_ecc: Run) -> None:
    def most(duration: str) -> int:
        tracemalloc.start()
        try:
            segway_ecc("model", "simulate", CONTROLLER, "--duration", duration)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    most("1")  # what is imported stays
    assert most("20") < most("1") + 100_000
