# SPDX-License-Identifier: MIT
"""How the segway moves on wheels that touch the ground through friction, slip and lift off, by MuJoCo.

The same robot as `segway_ecc.hil.plants.segway_body`, of the same parameters, as three rigid bodies: MuJoCo knows
nothing of the equations there, and they nothing of contact. A tyre is a ball of the wheel's radius; a bumper is a small
ball that touches the floor at the stop angle. Friction follows Coulomb's law with MuJoCo's elliptic cone; a tyre gives
way a little, and creeps by about 3 cm/s at 1 N m. Source of the elements: the MuJoCo documentation, "XML Reference".

With a backlash there is a joint between rotor and wheel that ends at half of it to either side; torque acts on the
rotor, and the encoder measures it.
"""

import importlib
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from segway_ecc.hil.plants.terrain import FRONT, LEFT, REAR, RIGHT, Piece, Terrain
from segway_ecc.node.models.segway_parameters import SegwayParameters

TIME_STEP_S: Final = 0.0005
_TYRE_S: Final = 0.004
"""Time constant of a tyre's contact, s: MuJoCo asks for at least two steps."""
_SLIDING_S: Final = 0.01
"""The same along the ground. A shorter one throws up a tyre that slides fast; with a longer one it creeps."""
_BUMPER_RADIUS: Final = 0.01
_BUMPER_REACH: Final = 0.3
"""How far ahead of the axle it touches the floor, m: assumed; the body's centre is half as far when it lies there."""
_BUMPER_FRICTION: Final = 0.3
"""Of plastic on a floor, assumed; a bumper carries about half of the robot, and so it lies still on 8 degrees."""
_ROTOR_SHARE: Final = 0.5
"""Of the wheel's inertia that turns with the motor, where a backlash parts them."""
_HAND_STIFFNESS: Final = 3000.0
_HAND_DAMPING: Final = 150.0
_HAND_SPEED: Final = 0.5
"""How fast a hand lifts, m/s; where it lets go, the robot falls."""
_NO_TORQUE: Final = np.zeros(3)
_NOTHING: Final = 1e-9
"""The mass of no payload, kg."""

Vector = npt.NDArray[np.float64]
"""Three numbers in the world's axes."""


class ContactBody:
    """The body, its wheels and the ground.

    Attributes:
        x, y: Of the axle's middle on the floor, m.
        v, q, w: Forward speed (m/s), pitch rate (rad/s), yaw rate (rad/s).
        pitch, heading: Against the vertical (rad), counter-clockwise (rad).
    """

    def __init__(
        self, parameters: SegwayParameters, terrain: Terrain, lean: float, *, backlash: float = 0.0, seed: int = 1
    ) -> None:
        """Stand still at the origin on level ground, leaning by `lean` (rad); `backlash` in rad, `seed` lays gravel."""
        self._mujoco: Any = importlib.import_module("mujoco")  # untyped, heavy, and not everywhere
        self._p, self._terrain = parameters, terrain
        self._model = self._mujoco.MjModel.from_xml_string(_mjcf(parameters, terrain, lean, backlash, seed))
        self._data = self._mujoco.MjData(self._model)
        self._wheels = [self._model.geom(side).id for side in (LEFT, RIGHT)]
        self._contacts = [self._model.pair_geom2 == wheel for wheel in self._wheels]
        self._encoders = [self._model.joint(f"{side} rotor").qposadr[0] for side in (LEFT, RIGHT)]
        self._rates = [self._model.joint(f"{side} rotor").dofadr[0] for side in (LEFT, RIGHT)]
        self._body, self._carried = self._model.body("body").id, self._model.body("payload").id
        self._floor = self._friction = (math.nan, math.nan)
        self._push = self._lift = self._lifted = 0.0
        self._hand: tuple[float, float, float] | None = None
        self.heading = self.slope = self._centre = 0.0
        self.pitch = lean
        self.load(0.0, 0.0)
        self._mujoco.mj_forward(self._model, self._data)
        self._motion = tuple(self._data.sensordata.tolist())
        self._observe()

    def tilt(self, slope: float) -> None:
        """Turn the ground under the robot until it rises along the x axis by `slope`, rad.

        The robot keeps its pitch against the vertical, as far as its bumpers let it.
        """
        change, self.slope = slope - self.slope, slope
        g, half = self._p.gravity, 0.5 * change
        self._model.opt.gravity[:] = (-g * math.sin(slope), 0.0, -g * math.cos(slope))
        if change:
            attitude = self._data.qpos[3:7]
            self._mujoco.mju_mulQuat(attitude, np.array((math.cos(half), 0.0, math.sin(half), 0.0)), attitude.copy())
            self._mujoco.mj_forward(self._model, self._data)
            self._observe()

    def load(self, payload: float, height: float) -> None:
        """Carry a point mass (kg) on the body's axis, `height` m above the axle."""
        mass, moment = self._p.body_mass, self._p.body_mass * self._p.body_height_of_centre
        self._centre = (moment + payload * height) / (mass + payload)
        self._model.body_mass[self._carried] = max(payload, _NOTHING)
        self._model.body_pos[self._carried, 2] = height
        self._mujoco.mj_setConst(self._model, self._mujoco.MjData(self._model))

    def push(self, force: float) -> None:
        """Push horizontally at the centre of mass, along the heading, N."""
        self._push = force

    def lift(self, height: float) -> None:
        """Have a hand hold the body at the IMU's height, so far above where it took hold, m; at 0 it lets go."""
        self._lift = height

    def set_friction(self, left: float, right: float) -> None:
        """Of each tyre on the floor, 1."""
        self._floor = (left, right)

    def wheel_angles(self) -> tuple[float, float]:
        """Of each rotor against the body, rad."""
        q = self._data.qpos
        return float(q[self._encoders[0]]), float(q[self._encoders[1]])

    def wheel_speeds(self) -> tuple[float, float]:
        """Of each rotor against the body, rad/s."""
        v = self._data.qvel
        return float(v[self._rates[0]]), float(v[self._rates[1]])

    def wheel_heights(self) -> tuple[float, float]:
        """Of the lowest point of each wheel, above the floor where it is level, m."""
        left, right = (float(self._data.geom_xpos[wheel][2]) - self._p.wheel_radius for wheel in self._wheels)
        return left, right

    @property
    def loads(self) -> tuple[float, float]:
        """What each wheel carries, N; zero in the air."""
        loads = [0.0, 0.0]
        force = np.zeros(6)
        for place, contact in enumerate(self._data.contact):
            for side, wheel in enumerate(self._wheels):
                if wheel in {contact.geom1, contact.geom2}:
                    self._mujoco.mj_contactForce(self._model, self._data, place, force)
                    loads[side] += float(force[0])
        return loads[0], loads[1]

    def measured_motion(self) -> Sequence[float]:
        """What a perfect IMU shows, in its axes: rates (rad/s), then specific forces (m/s2)."""
        return self._motion

    def step(self, seconds: float, left: float, right: float) -> None:
        """Advance by a whole number of time steps at constant torques of the motors, N m."""
        self._lay_friction()
        self._data.ctrl[:] = (left, right)
        count = round(seconds / TIME_STEP_S)
        motion = np.zeros(6)
        self._data.qfrc_applied[:] = 0.0
        for _ in range(count):
            if self._push or self._lift or self._hand is not None:
                self._act()
            self._mujoco.mj_step(self._model, self._data)
            motion += self._data.sensordata
        self._observe()
        self._motion = tuple((motion / count).tolist())

    def _lay_friction(self) -> None:
        """Give each wheel's contacts the friction of the place where the robot is."""
        x = self.x
        friction = self._terrain.friction(x, self._floor[0]), self._terrain.friction(x, self._floor[1])
        if friction != self._friction:
            self._friction = friction
            for contacts, value in zip(self._contacts, friction, strict=True):
                self._model.pair_friction[contacts, :2] = value

    def _act(self) -> None:
        """Apply the push and the hand."""
        data = self._data
        data.qfrc_applied[:] = 0.0
        if self._push:
            ahead = np.array((math.cos(self.heading), math.sin(self.heading), 0.0))
            self._apply(self._push * ahead, self._centre)
        if not self._lift:
            self._hand, self._lifted = None, 0.0
            return
        point, velocity = self._at(self._p.imu_height)
        if self._hand is None:
            self._hand = tuple(point)
        self._lifted = min(self._lift, self._lifted + _HAND_SPEED * TIME_STEP_S)
        x, y, z = self._hand
        off = np.array((x, y, z + self._lifted)) - point
        self._apply(_HAND_STIFFNESS * off - _HAND_DAMPING * velocity, self._p.imu_height)

    def _apply(self, force: Vector, height: float) -> None:
        point, _velocity = self._at(height)
        self._mujoco.mj_applyFT(self._model, self._data, force, _NO_TORQUE, point, self._body, self._data.qfrc_applied)

    def _at(self, height: float) -> tuple[Vector, Vector]:
        """Where a point on the body's axis is, and its velocity, in the world."""
        axes, rate = self._data.xmat[self._body].reshape(3, 3), self._data.qvel[3:6]
        arm = height * axes[:, 2]
        return self._data.xpos[self._body] + arm, self._data.qvel[:3] + np.cross(axes @ rate, arm)

    def _observe(self) -> None:
        """Take the state over from MuJoCo; pitch and heading go on past a half turn."""
        position, velocity, axes = self._data.qpos, self._data.qvel.tolist(), self._data.xmat[self._body].tolist()
        self.x, self.y = float(position[0]), float(position[1])
        left_x, left_y = axes[1], axes[4]
        across = math.hypot(left_x, left_y) or 1.0
        ahead_x, ahead_y = left_y / across, -left_x / across
        lean = math.atan2(axes[2] * ahead_x + axes[5] * ahead_y, axes[8])
        rise = math.atan2(math.sin(self.slope) * ahead_x, math.cos(self.slope))
        self.pitch = _nearest(lean - rise, self.pitch)
        self.heading = _nearest(math.atan2(ahead_y, ahead_x), self.heading)
        self.v = velocity[0] * ahead_x + velocity[1] * ahead_y
        self.q = velocity[4]
        self.w = axes[6] * velocity[3] + axes[7] * velocity[4] + axes[8] * velocity[5]


def _nearest(angle: float, to: float) -> float:
    return angle + 2.0 * math.pi * round((to - angle) / (2.0 * math.pi))


def _mjcf(p: SegwayParameters, terrain: Terrain, lean: float, backlash: float, seed: int) -> str:
    """The robot with its axle over the origin, and the ground."""
    pieces = list(terrain.pieces(seed))
    ground = "\n    ".join(f'<geom name="ground {place}" {piece.shape}/>' for place, piece in enumerate(pieces))
    down, sin, cos = p.wheel_radius - _BUMPER_RADIUS, math.sin(p.stop_angle), math.cos(p.stop_angle)
    out, up = _BUMPER_REACH * cos + down * sin, _BUMPER_REACH * sin - down * cos
    bumper = f'type="sphere" size="{_BUMPER_RADIUS}" mass="0"'
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{TIME_STEP_S}" integrator="implicitfast" cone="elliptic" impratio="100"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <pair condim="3" solref="{_TYRE_S} 1" solreffriction="{_SLIDING_S} 1" solimp="0.95 0.99 0.001"
      friction="{_BUMPER_FRICTION} {_BUMPER_FRICTION} 0 0 0"/>
    <joint type="hinge" axis="0 1 0" solreflimit="{_TYRE_S} 1" solreffriction="{_TYRE_S} 1"/>
  </default>
  <worldbody>
    {ground}
    <body name="body" pos="0 0 {terrain.start_height + p.wheel_radius}" euler="0 {lean} 0">
      <freejoint/>
      <inertial pos="0 0 {p.body_height_of_centre}" mass="{p.body_mass}"
        diaginertia="{p.body_roll_inertia} {p.body_pitch_inertia} {p.body_yaw_inertia}"/>
      <site name="imu" pos="0 0 {p.imu_height}"/>
      <geom name="{FRONT}" {bumper} pos="{out} 0 {up}"/>
      <geom name="{REAR}" {bumper} pos="{-out} 0 {up}"/>
      <body name="payload">
        <inertial pos="0 0 0" mass="{_NOTHING}" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
      {_wheel(p, LEFT, 0.5 * p.track, backlash)}
      {_wheel(p, RIGHT, -0.5 * p.track, backlash)}
    </body>
  </worldbody>
  <contact>
    {_contacts(pieces)}
  </contact>
  <actuator><motor joint="{LEFT} rotor"/><motor joint="{RIGHT} rotor"/></actuator>
  <sensor><gyro site="imu"/><accelerometer site="imu"/></sensor>
</mujoco>"""


def _contacts(pieces: Sequence[Piece]) -> str:
    """What may touch what: nothing else does."""
    return "\n    ".join(
        f'<pair geom1="ground {place}" geom2="{part}"/>'
        for place, piece in enumerate(pieces)
        for part in piece.touched_by
    )


def _wheel(p: SegwayParameters, side: str, y: float, backlash: float) -> str:
    """A wheel on the rotor's joint, or with a backlash on one of its own behind it."""
    bearing = f'damping="{p.viscous_friction}" frictionloss="{p.coulomb_friction}"'
    across = p.wheel_diameter_inertia
    tyre = f'<geom name="{side}" type="sphere" size="{p.wheel_radius}" mass="0"/>'
    if not backlash:
        return f"""
      <body pos="0 {y} 0">
        <joint name="{side} rotor" {bearing}/>
        <inertial pos="0 0 0" mass="{p.wheel_mass}" diaginertia="{across} {p.wheel_inertia} {across}"/>
        {tyre}
      </body>"""
    rotor, half = _ROTOR_SHARE * p.wheel_inertia, 0.5 * backlash
    return f"""
      <body pos="0 {y} 0">
        <joint name="{side} rotor" {bearing}/>
        <inertial pos="0 0 0" mass="{_ROTOR_SHARE * p.wheel_mass}" diaginertia="{0.5 * across} {rotor} {0.5 * across}"/>
        <body>
          <joint limited="true" range="{-half} {half}"/>
          <inertial pos="0 0 0" mass="{p.wheel_mass * (1.0 - _ROTOR_SHARE)}"
            diaginertia="{0.5 * across} {p.wheel_inertia - rotor} {0.5 * across}"/>
          {tyre}
        </body>
      </body>"""
