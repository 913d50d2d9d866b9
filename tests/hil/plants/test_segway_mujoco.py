# SPDX-License-Identifier: MIT
"""The segway's plant against MuJoCo, which knows nothing of its equations: the same robot of three rigid bodies.

MuJoCo's wheels roll on contacts with friction, ours by a constraint: contacts are stiff here, steps short. Upright, an
error grows by e^9.7 each second whoever computes it. So what runs longer than a fall is either held by one and the same
law, which each side applies to its own state, or hangs from the axle (nothing of the body touches the floor), where the
same torques can be given open loop.
"""

import importlib
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest

from segway_ecc.hil.plants.segway import SegwayTorquePlant
from segway_ecc.node.models.segway_parameters import PUBLISHED

pytestmark = pytest.mark.mujoco

STEPS_EACH = 5
# Where it turns, MuJoCo's contacts give way sideways and the body rolls a little on them, half a metre below the IMU.
# That ours are the accelerations of its own path is shown in test_segway_hardware_sensors.py.
ROLLING = (0.6, 2.0, 0.8)
P = PUBLISHED
IDEAL = {
    "SensorErrors": 0.0,
    "ViscousFriction": 0.0,
    "CoulombFriction": 0.0,
    "TorqueTimeConstant": 0.0,
    "TorqueLimit": 100.0,
    "SupplyVoltage": 1e4,
    "StopAngle": 1e3,
    "PayloadHeight": 0.6,
}
"""Without friction, lag, limits, stops and sensor errors."""
LAW = (-14.0, -1.6, -0.25)
"""Torque (both wheels) per pitch, pitch rate and speed that holds the robot up; N m per rad, rad/s, m/s."""


class State(NamedTuple):
    """What is compared: rad, rad/s, m/s, rad, rad/s, m, m, and the IMU's six."""

    pitch: float
    pitch_rate: float
    speed: float
    heading: float
    yaw_rate: float
    x: float
    y: float
    imu: tuple[float, ...]


class Trial(NamedTuple):
    """One run: how it starts, what the wheels are given, what else acts, and how far accelerations may differ, m/s2."""

    seconds: float
    pitch: float
    torques: Callable[[float, State], tuple[float, float]]
    slope: float = 0.0
    payload: float = 0.0
    push: float = 0.0
    accelerations: tuple[float, float, float] = (0.01, 0.01, 0.01)


def _free(_t: float, _state: State) -> tuple[float, float]:
    return 0.0, 0.0


def _profile(t: float) -> tuple[float, float]:
    """Left and right differ all the time, and turn round."""
    return 0.25 * math.sin(5.0 * t), 0.2 * math.sin(3.0 * t + 0.5)


def _open_loop(t: float, _state: State) -> tuple[float, float]:
    return _profile(t)


def _held(t: float, state: State) -> tuple[float, float]:
    hold = 0.5 * (LAW[0] * state.pitch + LAW[1] * state.pitch_rate + LAW[2] * state.speed)
    left, right = _profile(t)
    return 3.0 * left - hold, 3.0 * right - hold


def _held_straight(_t: float, state: State) -> tuple[float, float]:
    hold = 0.5 * (LAW[0] * state.pitch + LAW[1] * state.pitch_rate + LAW[2] * state.speed)
    return -hold, -hold


TRIALS = {
    "falls from 2 degrees": Trial(1.0, math.radians(2.0), _free),
    "falls backwards on a slope": Trial(1.0, math.radians(-2.0), _free, slope=0.2),
    "hangs and is driven, left unlike right": Trial(2.0, math.pi - 0.3, _open_loop, accelerations=ROLLING),
    "is held up and driven, left unlike right": Trial(2.0, 0.1, _held, accelerations=ROLLING),
    "climbs with a payload": Trial(2.0, 0.1, _held_straight, slope=0.1, payload=1.5),
    "is pushed": Trial(2.0, 0.05, _held_straight, push=6.0),
}
ALLOWED = State(
    pitch=math.radians(0.02),
    pitch_rate=0.004,
    speed=0.005,
    heading=math.radians(0.5),
    yaw_rate=0.01,
    x=0.002,
    y=0.002,
    imu=(0.005, 0.004, 0.01),
)


def _ours(trial: Trial) -> Iterator[State]:
    plant = SegwayTorquePlant({**IDEAL, "InitialPitch": trial.pitch})
    plant.initialize((0.0, 0.0))
    for name, value in (("Slope", trial.slope), ("Payload", trial.payload), ("PushForce", trial.push)):
        plant.write(name, value)
    state = _state_of(plant)
    for step in range(round(trial.seconds / plant.step_size)):
        plant.step(trial.torques(step * plant.step_size, state))
        state = _state_of(plant)
        yield state


def _state_of(plant: SegwayTorquePlant) -> State:
    names = ("pitch", "pitch_rate", "linear_velocity", "heading", "angular_velocity", "x", "y")
    imu = (f"imu.{kind}_{axis}" for kind in ("angular_velocity", "linear_acceleration") for axis in "xyz")
    pitch, rate, speed, heading, yaw_rate, x, y = (plant.read(f"truth.{name}") for name in names)
    return State(pitch, rate, speed, heading, yaw_rate, x, y, tuple(map(plant.read, imu)))


def _wheel(name: str, y: float) -> str:
    return f"""
      <body name="{name}" pos="0 {y} 0">
        <joint name="{name}" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="{P.wheel_mass}"
          diaginertia="{P.wheel_diameter_inertia} {P.wheel_inertia} {P.wheel_diameter_inertia}"/>
        <geom type="sphere" size="{P.wheel_radius}" contype="1" conaffinity="1"/>
      </body>"""


def _mjcf(trial: Trial) -> str:
    """The robot with its axle over the origin; a slope is gravity that leans back, a wheel a ball on its contact."""
    g, lean = P.gravity, trial.pitch + trial.slope
    payload = f'<body pos="0 0 {IDEAL["PayloadHeight"]}"><inertial pos="0 0 0" mass="{trial.payload}" {{}}/></body>'
    return f"""
<mujoco>
  <option timestep="{SegwayTorquePlant.step_size / STEPS_EACH}" integrator="RK4" cone="elliptic"
    impratio="1000" gravity="{-g * math.sin(trial.slope)} 0 {-g * math.cos(trial.slope)}"/>
  <default><geom friction="5 0 0" condim="3" solref="0.0005 1" solimp="0.99 0.999 0.0001"/></default>
  <worldbody>
    <geom type="plane" size="50 50 1"/>
    <body name="body" pos="0 0 {P.wheel_radius}" euler="0 {math.degrees(lean)} 0">
      <freejoint/>
      <inertial pos="0 0 {P.body_height_of_centre}" mass="{P.body_mass}"
        diaginertia="{P.body_roll_inertia} {P.body_pitch_inertia} {P.body_yaw_inertia}"/>
      <site name="imu" pos="0 0 {P.imu_height}"/>
      {payload.format('diaginertia="1e-9 1e-9 1e-9"') if trial.payload else ""}
      {_wheel("left", 0.5 * P.track)}{_wheel("right", -0.5 * P.track)}
    </body>
  </worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator>
  <sensor><gyro site="imu"/><accelerometer site="imu"/></sensor>
</mujoco>"""


def _theirs(trial: Trial) -> Iterator[State]:
    mujoco: Any = importlib.import_module("mujoco")  # untyped, heavy, and not everywhere
    model = mujoco.MjModel.from_xml_string(_mjcf(trial))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    angles = [trial.pitch, 0.0]
    state = _state_there(data, trial, angles)
    for step in range(round(trial.seconds / SegwayTorquePlant.step_size)):
        data.ctrl[:] = trial.torques(step * SegwayTorquePlant.step_size, state)
        for _ in range(STEPS_EACH):
            _push(mujoco, model, data, trial.push)
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        state = _state_there(data, trial, angles)
        yield state


def _push(mujoco: Any, model: Any, data: Any, force: float) -> None:
    data.qfrc_applied[:] = 0.0
    body = data.body("body")
    point, ahead = body.xpos + P.body_height_of_centre * body.xmat.reshape(3, 3)[:, 2], (force, 0.0, 0.0)
    mujoco.mj_applyFT(model, data, ahead, (0.0, 0.0, 0.0), point, body.id, data.qfrc_applied)


def _state_there(data: Any, trial: Trial, angles: list[float]) -> State:
    """The state in our terms; `angles` keeps pitch and heading, which go on past a half turn."""
    axes, velocity = data.body("body").xmat.reshape(3, 3), data.qvel
    # Left of the body is along the axle; what is ahead of it lies in the ground.
    left = (axes[0, 1], axes[1, 1])
    norm = math.hypot(*left)
    ahead = (left[1] / norm, -left[0] / norm)
    lean = math.atan2(axes[0, 2] * ahead[0] + axes[1, 2] * ahead[1], axes[2, 2])
    angles[0] = _nearest(lean - trial.slope, angles[0])
    angles[1] = _nearest(math.atan2(ahead[1], ahead[0]), angles[1])
    speed = velocity[0] * ahead[0] + velocity[1] * ahead[1]
    # A free joint's angular velocity is in the body's axes.
    yaw_rate = axes[2, 0] * velocity[3] + axes[2, 1] * velocity[4] + axes[2, 2] * velocity[5]
    return State(angles[0], velocity[4], speed, angles[1], yaw_rate, data.qpos[0], data.qpos[1], tuple(data.sensordata))


def _nearest(angle: float, to: float) -> float:
    return angle + 2.0 * math.pi * round((to - angle) / (2.0 * math.pi))


def _flat(state: State) -> list[float]:
    return [*state[:-1], *state.imu]


def _largest_mean(values: list[float]) -> float:
    """Over 50 ms, for the accelerometer: in MuJoCo stiff contacts chatter, which moves nothing but is felt."""
    return max(abs(sum(values[i : i + 20])) / 20 for i in range(0, len(values), 20))


NAMES = [*State._fields[:-1], *(f"imu {kind} {axis}" for kind in ("gyro", "accelerometer") for axis in "xyz")]


@pytest.mark.parametrize("trial", TRIALS.values(), ids=list(TRIALS))
def test_moves_as_in_mujoco(trial: Trial) -> None:
    pairs = [(_flat(a), _flat(b)) for a, b in zip(_ours(trial), _theirs(trial), strict=True)]
    off_by = [[a[i] - b[i] for a, b in pairs] for i in range(len(NAMES))]
    largest = [*(max(map(abs, values)) for values in off_by[:-3]), *map(_largest_mean, off_by[-3:])]
    moved = [max(abs(a[i]) for a, _ in pairs) for i in range(len(NAMES))]
    report = ", ".join(
        f"{name} {off:.2g} (reaches {most:.2g})" for name, off, most in zip(NAMES, largest, moved, strict=True)
    )
    allowed = [*_flat(ALLOWED), *trial.accelerations]
    assert all(off <= most for off, most in zip(largest, allowed, strict=True)), f"largest differences: {report}"
