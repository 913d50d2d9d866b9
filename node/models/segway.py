# SPDX-License-Identifier: MIT
"""The controller of a segway: a body on two wheels that it keeps upright, still or on its way.

In each step it estimates how the robot leans and moves (`segway_estimate`), decides what it is doing
and works out the torques that follow (`segway_law`). Its gains are parameters: `segway-ecc design gains` finds them.
Frames are those of REP-103; pitch is positive when the body leans forward.
"""

from collections.abc import Sequence
from typing import ClassVar, Final

from msgspec.structs import astuple

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.cart import POSE_OUTPUTS, SETPOINT_STATES
from segway_ecc.node.models.segway_estimate import Estimate, Estimator, SegwayMeasurement, within
from segway_ecc.node.models.segway_law import Law, Motion, Phase, PhaseProgress, PhaseRules, stopped, torques
from segway_ecc.node.models.segway_parameters import PUBLISHED, VARIABLES

STEP_SIZE: Final = 0.005

_INPUTS: Final = (
    Variable("LeftAngle", "rad"),
    Variable("LeftVelocity", "rad/s"),
    Variable("RightAngle", "rad"),
    Variable("RightVelocity", "rad/s"),
    Variable("GyroX", "rad/s"),
    Variable("GyroY", "rad/s"),
    Variable("GyroZ", "rad/s"),
    Variable("AccelerationX", "m/s2"),
    Variable("AccelerationY", "m/s2"),
    Variable("AccelerationZ", "m/s2"),
)
_BODY: Final = (
    *(v for v in VARIABLES if v.name in {"WheelRadius", "Track", "ImuHeight"}),
    Variable(
        "StopPitch",
        "rad",
        PUBLISHED.stop_angle,
        Write.STATIC,
        "where the body touches the ground",
        minimum=0.01,
        maximum=1.6,
    ),
    Variable(
        "TorqueLimit",
        "N m",
        1.3,
        Write.STATIC,
        "of each wheel: what its tyre carries without slipping",
        minimum=0.0,
        maximum=1000.0,
    ),
    Variable(
        "SwingLength",
        "m",
        PUBLISHED.body_height_of_centre
        + PUBLISHED.body_pitch_inertia / (PUBLISHED.body_mass * PUBLISHED.body_height_of_centre),
        Write.STATIC,
        "how high above the axle a blow to the body leaves the axle at rest: J / (m l)",
        minimum=0.01,
        maximum=10.0,
    ),
)
_MOTOR: Final = tuple(
    v for v in VARIABLES if v.name in {"MotorResistance", "MotorConstant", "GearRatio", "SupplyVoltage"}
)
_ESTIMATE: Final = (
    Variable(
        "TiltTime",
        "s",
        2.0,
        Write.STATIC,
        "how slowly the pitch follows the accelerometer",
        minimum=0.05,
        maximum=100.0,
    ),
    Variable(
        "BiasTime", "s", 4.0, Write.STATIC, "how slowly the gyro's biases are learnt", minimum=0.05, maximum=1000.0
    ),
)
GAINS: Final = (
    Variable("TravelGain", "N", 0.0, Write.STATIC, minimum=-100000.0, maximum=0.0),
    Variable("VelocityGain", "N s", 0.0, Write.STATIC, minimum=-100000.0, maximum=0.0),
    Variable("PitchGain", "N m/rad", 0.0, Write.STATIC, minimum=-100000.0, maximum=0.0),
    Variable("PitchRateGain", "N m s/rad", 0.0, Write.STATIC, minimum=-100000.0, maximum=0.0),
    Variable("SentGain", "1", 0.0, Write.STATIC, minimum=-10.0, maximum=10.0),
    Variable("SentBeforeGain", "1", 0.0, Write.STATIC, minimum=-10.0, maximum=10.0),
    Variable("IntegralGain", "N/s", 0.0, Write.STATIC, minimum=-100000.0, maximum=0.0),
    Variable("PitchPerAcceleration", "rad s2/m", 0.0, Write.STATIC, minimum=0.0, maximum=10.0),
    Variable("TorquePerAcceleration", "N m s2/m", 0.0, Write.STATIC, minimum=-10000.0, maximum=10000.0),
    Variable("HeadingGain", "N m/rad", 0.0, Write.STATIC, minimum=0.0, maximum=100000.0),
    Variable("YawRateGain", "N m s/rad", 0.0, Write.STATIC, minimum=0.0, maximum=100000.0),
    Variable("TorquePerYawAcceleration", "N m s2/rad", 0.0, Write.STATIC, minimum=0.0, maximum=10000.0),
)
"""What `segway-ecc design gains` finds; with the zeros here the model does not start."""
_LIMITS: Final = (
    Variable("MaxSpeed", "m/s", 1.5, Write.STATIC, minimum=0.0, maximum=20.0, tunable=True),
    Variable("MaxAcceleration", "m/s2", 0.8, Write.STATIC, minimum=0.0, maximum=20.0, tunable=True),
    Variable("MaxYawRate", "rad/s", 2.0, Write.STATIC, minimum=0.0, maximum=30.0, tunable=True),
    Variable("MaxYawAcceleration", "rad/s2", 3.0, Write.STATIC, minimum=0.0, maximum=100.0, tunable=True),
    Variable("MaxTravelError", "m", 0.5, Write.STATIC, minimum=0.0, maximum=10.0),
    Variable("MaxHeadingError", "rad", 0.5, Write.STATIC, minimum=0.0, maximum=3.2),
    Variable("MaxIntegral", "m s", 0.5, Write.STATIC, minimum=0.0, maximum=10.0),
    Variable("MaxTurningTorque", "N m", 1.0, Write.STATIC, minimum=0.0, maximum=1000.0),
    Variable("TorqueSlew", "N m/s", 500.0, Write.STATIC, minimum=1.0, maximum=1000000.0),
)
_PHASES: Final = (
    Variable(
        "SettlingTime",
        "s",
        0.5,
        Write.STATIC,
        "at rest before it stands up, while the gyro's biases are learnt",
        minimum=0.0,
        maximum=60.0,
    ),
    Variable("StandUpTime", "s", 3.0, Write.STATIC, "after which it gives up", minimum=0.1, maximum=60.0),
    Variable("FallTime", "s", 0.5, Write.STATIC, "down, after which it gives up", minimum=0.0, maximum=10.0),
    Variable(
        "SitDownTime", "s", 3.0, Write.STATIC, "after which the motors rest wherever it is", minimum=0.1, maximum=60.0
    ),
    Variable("SitDownRate", "rad/s", 0.8, Write.STATIC, "at which it leans down", minimum=0.01, maximum=10.0),
    Variable(
        "RunawaySpeed",
        "m/s",
        4.0,
        Write.STATIC,
        "faster than the robot ever goes: it gives up",
        minimum=0.1,
        maximum=50.0,
    ),
)
SETPOINTS: Final = (
    *SETPOINT_STATES,
    Variable("Stand", "1", 1.0, Write.NOW, "1: stand up and balance; 0: sit down and rest", minimum=0.0, maximum=1.0),
)


def _states(prefix: str, names: Sequence[str]) -> tuple[Variable, ...]:
    return tuple(Variable(prefix + "".join(word.capitalize() for word in name.split("_"))) for name in names)


_STATES: Final = (
    *SETPOINTS,
    *_states("Estimated", Estimate.__struct_fields__),
    *_states("Reference", Motion.__struct_fields__),
    *_states("Doing", PhaseProgress.__struct_fields__),
)
_ESTIMATE_AT: Final = len(SETPOINTS)
_MOTION_AT: Final = _ESTIMATE_AT + len(Estimate.__struct_fields__)

_OUTPUTS: Final = (*POSE_OUTPUTS, Variable("Pitch", "rad"), Variable("PitchRate", "rad/s"), Variable("Phase", "1"))


class SegwayController(SectionedModel):
    """IMU and encoders in, torques of the wheels out.

    Its states are by name what it holds in `estimate`, `motion` and `progress`; nobody but the model writes those.
    """

    name = "segway-controller"
    step_size = STEP_SIZE
    method = Method.DISCRETE
    inputs = _INPUTS
    outputs: ClassVar[Sequence[Variable]] = (*_OUTPUTS, Variable("LeftTorque", "N m"), Variable("RightTorque", "N m"))
    parameters: ClassVar[Sequence[Variable]] = (*_BODY, *_ESTIMATE, *GAINS, *_LIMITS, *_PHASES)
    states = _STATES

    def initial(self) -> None:
        """Nothing was measured yet."""
        self.measured = SegwayMeasurement(*(0.0 for _ in _INPUTS))
        self.estimate = Estimate()
        self.motion = Motion()
        self.progress = PhaseProgress()

    def static(self) -> None:
        """Gather the parameters as the equations use them.

        Raises:
            ModelError: The gains were left out.
        """
        p = self.p
        if p["PitchPerAcceleration"] <= 0.0:
            raise ModelError(
                f"model '{self.name}' has no gains: `segway-ecc design gains` puts them into the robot file"
            )
        self.estimator = Estimator(STEP_SIZE, p)
        self.law = Law(STEP_SIZE, p)
        self.rules = PhaseRules(STEP_SIZE, p)
        self.torque_limit = p["TorqueLimit"]

    def input(self, u: Sequence[float]) -> None:
        """Take what is measured; the first measurement is how the robot lies."""
        self.measured = SegwayMeasurement(*u)
        if self.estimate.since == 0.0:
            self.estimate = self.estimator.start(self.measured)
            self.s[_ESTIMATE_AT:_MOTION_AT] = astuple(self.estimate)

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - nothing depends on the time
        """The next states."""
        linear, angular, stand = s[0], s[1], s[2]
        progress = self.progress
        self.estimate = self.estimator.advance(
            self.estimate,
            self.measured,
            resting=progress.is_resting,
            may_slip=progress.may_slip,
            sent=self.motion.sent if progress.balances else None,
        )
        self.progress = self.rules.advance(self.progress, self.estimate, stand=stand >= 0.5)  # noqa: PLR2004 - half way from 0 to 1
        self.motion = self.moved(linear, angular)
        return [linear, angular, stand, *astuple(self.estimate), *astuple(self.motion), *astuple(self.progress)]

    def moved(self, linear: float, angular: float) -> Motion:
        """The reference one period later towards the set-points, m/s and rad/s, with the torques that are sent now."""
        law, motion, e, limit = self.law, self.motion, self.estimate, self.torque_limit
        match self.progress.phase:
            case Phase.BALANCING:  # for nearly all of its time, and so asked for first
                return law.balanced(law.ramped(motion, e, linear, angular), e, limit, is_up=True)
            case Phase.STANDING_UP:
                begins = self.progress.elapsed == 0.0
                return law.balanced(law.rising(motion, e, limit, begins=begins), e, limit)
            case Phase.SITTING_DOWN:
                return law.braked(law.here(motion, e), self.rules.torque_down(e), limit)
            case Phase.LIFTED:
                return law.lifted(law.here(motion, e), e, limit)
            case _:
                return stopped(law.here(motion, e))

    @property
    def torques(self) -> tuple[float, float]:
        """What the left and the right wheel are to push, N m."""
        return torques(self.motion)

    def output(self) -> Sequence[float]:
        """Pose, velocities, lean, phase and the torques."""
        return [*self.published(), *self.torques]

    def published(self) -> Sequence[float]:
        """What is published of the robot."""
        e = self.estimate
        phase = float(self.progress.phase)
        return e.x, e.y, e.heading, e.velocity, e.yaw_rate, e.pitch, e.pitch_rate, phase


class SegwayVoltageController(SegwayController):
    """The same for motors that take a voltage: V = R i + K w with the current i that gives the torque.

    The motor's inductance is left out: its L / R must be short against the step.
    """

    name = "segway-voltage-controller"
    outputs = (*_OUTPUTS, Variable("LeftVoltage", "V"), Variable("RightVoltage", "V"))
    parameters = (*SegwayController.parameters, *_MOTOR)

    def static(self) -> None:
        """Gather the parameters; see `SegwayController.static`."""
        super().static()
        p = self.p
        self.resistance = p["MotorResistance"]
        self.wheel_constant = p["MotorConstant"] * p["GearRatio"]
        self.supply = p["SupplyVoltage"]

    def output(self) -> Sequence[float]:
        """Pose, velocities, lean, phase and the voltages."""
        if self.progress.is_resting:
            return [*self.published(), 0.0, 0.0]
        m, (left, right) = self.measured, self.torques
        return [*self.published(), self.volts(left, m.left_velocity), self.volts(right, m.right_velocity)]

    def volts(self, torque: float, velocity: float) -> float:
        """The voltage for a torque at the wheel, N m, that turns at a velocity against the body, rad/s."""
        voltage = self.resistance * torque / self.wheel_constant + self.wheel_constant * velocity
        return within(voltage, self.supply)
