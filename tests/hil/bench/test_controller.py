# SPDX-License-Identifier: MIT
"""The model of the bench: what its files were made from, and that it is the cart's controller."""

import math
from pathlib import Path

import pytest

import segway_ecc.hil.bench
import segway_ecc.node.models
from segway_ecc.hil.bench.rig import copy_controller
from segway_ecc.node.models import cart
from segway_ecc.node.models.cart import CartController
from segway_ecc.node.native.load import load_native
from tests.fixtures.twenty_sim.generate import submodel
from tests.fixtures.twenty_sim.spec import Quantity, Spec, State, section

FOLDER = Path(segway_ecc.hil.bench.__file__).with_name("controller")
SUBMODEL = Path(segway_ecc.node.models.__file__).with_name("cart_submodel")
CONTROLLER = Spec(
    name="CartController",
    method="RungeKutta4",
    step_size=cart.STEP_SIZE,
    finish_time=8.0,
    inputs=(
        Quantity("LinearSetpoint", "m/s"),
        Quantity("AngularSetpoint", "rad/s"),
        Quantity("LeftVelocity", "rad/s"),
        Quantity("RightVelocity", "rad/s"),
    ),
    outputs=tuple(Quantity(v.name, v.unit) for v in cart.CartController.outputs),
    parameters=(
        *(Quantity(rf"Body\{p.name}", p.unit, p.value) for p in cart.WHEEL_PARAMETERS),
        *(Quantity(rf"Controller\{p.name}", p.unit, p.value) for p in cart.CONTROLLER_PARAMETERS),
    ),
    states=tuple(State(rf"Pose\{s.name}", rf"Pose\{s.name}_rate", s.unit, s.value) for s in cart.POSE_STATES),
    variables=(
        Quantity(r"Body\halfRadius", "m"),
        Quantity(r"Body\turn"),
        Quantity(r"Controller\kf"),
        Quantity(r"Controller\perRadius"),
        Quantity(r"Controller\halfTrack", "m"),
        Quantity(r"Controller\steer"),
        Quantity(r"Controller\Left.set", "rad/s"),
        Quantity(r"Controller\Right.set", "rad/s"),
    ),
    static=section(
        r"{Body\halfRadius} = 0.5 * {Body\WheelRadius}",
        r"{Body\turn} = {Body\WheelRadius} / {Body\Track}",
        r"{Controller\kf} = ({Body\Resistance} * {Body\Friction} + {Body\MotorConstant} * {Body\MotorConstant})"
        r" / {Body\MotorConstant}",
        r"{Controller\perRadius} = 1.0 / {Body\WheelRadius}",
        r"{Controller\halfTrack} = 0.5 * {Controller\AssumedTrack}",
    ),
    dynamic=section(
        r"{LinearVelocity} = {Body\halfRadius} * ({LeftVelocity} + {RightVelocity})",
        r"{AngularVelocity} = {Body\turn} * ({RightVelocity} - {LeftVelocity})",
        r"{Pose\PoseX_rate} = {LinearVelocity} * cos ({Pose\PoseHeading})",
        r"{Pose\PoseY_rate} = {LinearVelocity} * sin ({Pose\PoseHeading})",
        r"{Pose\PoseHeading_rate} = {AngularVelocity}",
    ),
    output=section(
        r"{Controller\steer} = {AngularSetpoint} * {Controller\halfTrack}",
        r"{Controller\Left.set} = ({LinearSetpoint} - {Controller\steer}) * {Controller\perRadius}",
        r"{Controller\Right.set} = ({LinearSetpoint} + {Controller\steer}) * {Controller\perRadius}",
        r"{LeftVoltage} = {Controller\kf} * {Controller\Left.set}"
        r" + {Controller\FeedbackGain} * ({Controller\Left.set} - {LeftVelocity})",
        r"{RightVoltage} = {Controller\kf} * {Controller\Right.set}"
        r" + {Controller\FeedbackGain} * ({Controller\Right.set} - {RightVelocity})",
        r"{X} = {Pose\PoseX}",
        r"{Y} = {Pose\PoseY}",
        r"{Heading} = {Pose\PoseHeading}",
    ),
)


def test_the_packaged_files_are_what_is_made_of_the_equations(tmp_path: Path) -> None:
    submodel(CONTROLLER, tmp_path)
    made = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    del made["xxmain.c"]  # a program, and the model is to be linked into others
    packaged = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.iterdir()}
    del packaged["README.md"]
    assert packaged == {name: made[name] for name in packaged}
    for name in made.keys() - packaged.keys():  # those that are alike for every submodel, but for its name
        shared = (SUBMODEL / name).read_text(encoding="utf-8")
        assert shared == made[name].replace("CartController", "Cart")


@pytest.mark.compiler
def test_its_voltages_are_those_of_the_carts_controller(tmp_path: Path) -> None:
    copy_controller(tmp_path / "model")
    theirs, ours = load_native(tmp_path / "model"), CartController()
    theirs.initialize((1.0, 0.5, 0.0, 0.0))
    ours.initialize((0.0, 0.0))
    for step in range(200):
        left, right = 20.0 + math.sin(0.1 * step), 21.0 + math.cos(0.1 * step)
        linear, angular = 1.0 + 0.01 * step, 0.5 - 0.005 * step
        ours.write("LinearSetpoint", linear)
        ours.write("AngularSetpoint", angular)
        y = theirs.step((linear, angular, left, right))
        assert y[3:] == pytest.approx(ours.step((left, right))[3:], abs=1e-12)


@pytest.mark.compiler
def test_its_pose_is_that_of_the_carts_controller(tmp_path: Path) -> None:
    """At constant speeds: generated code begins a step with the rates of the end of the last one."""
    copy_controller(tmp_path / "model")
    theirs, ours = load_native(tmp_path / "model"), CartController()
    theirs.initialize((0.0, 0.0, 20.0, 21.0))
    ours.initialize((20.0, 21.0))
    for _ in range(200):
        y = theirs.step((0.0, 0.0, 20.0, 21.0))
        assert y[:3] == pytest.approx(ours.step((20.0, 21.0))[:3], abs=1e-9)
