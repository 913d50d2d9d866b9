# SPDX-License-Identifier: MIT
"""Everything that is watched of one robot, brought together."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.check import Check, View, periods_in
from segway_ecc.node.safety.deadlines import DeadlineWatch, RateMeter
from segway_ecc.node.safety.gravity import GravityCheck
from segway_ecc.node.safety.plausibility import (
    MOVING,
    FollowingError,
    Frozen,
    RangeCheck,
    Runaway,
    VelocityAgreement,
    WheelSpeed,
    YawAgreement,
)
from segway_ecc.node.safety.posture import LIES_FOR_S, Body
from segway_ecc.node.safety.pre_arm import PreArmCheck, PreArmMeasurements, pre_arm_checks
from segway_ecc.node.safety.residual import ResidualMonitor, command_places
from segway_ecc.node.safety.settings import ChecklistSettings, SafetySettings
from segway_ecc.node.safety.tilt import StillWatch, TiltWatch

_SIDES: Final = ("left", "right")
TWO_WHEELS: Final = (_SIDES,)
"""The wheels of a robot whose file does not name them: the left and the right one of each pair."""
_GYRO: Final = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
_IMU: Final = (*_GYRO, *(f"imu.linear_acceleration_{axis}" for axis in "xyz"))
_VELOCITY: Final = ".velocity"
_SUPPLY: Final = "supply.voltage"


class SafetyMonitor:
    """Looks at the sensors and the deadlines in every cycle; reports what is wrong, and whether the robot may arm.

    The robot or a check `needs` the signals at these places: one of them lost is a fault. `faults` is what was wrong in
    the newest cycle, `elapsed_s` how long that began after the one before, s, and `body` what is measured there of a
    robot that has a posture. `residual` compares its acceleration with what was designed, where that is watched.
    """

    def __init__(  # noqa: PLR0913, PLR0917 - what a robot measures, is made of and may do
        self,
        settings: SafetySettings,
        signals: Sequence[str],
        used: Sequence[int],
        period_ns: int,
        sends: Sequence[str] = (),
        wheels: Sequence[tuple[str, str]] = TWO_WHEELS,
    ) -> None:
        """Watch a robot that measures `signals`, of whose places its model has `used`, and has this period, ns.

        It commands what it `sends`, and drives on `wheels`: a left and a right axis for each pair.

        Raises:
            ConfigurationError: A check needs a signal that the robot does not measure, or a command it does not send.
        """
        self._settings = settings
        self._signals = {name: index for index, name in enumerate(signals)}
        self._axes = [name.removesuffix(_VELOCITY) for name in signals if name.endswith(_VELOCITY)]
        self._pairs = wheels
        has_imu = all(name in self._signals for name in _IMU)
        self._wheels = [self._signals[name] for name in signals if name.endswith(_VELOCITY)]
        self._supply = self._signals.get(_SUPPLY)
        self._imu: tuple[int, ...] = tuple(self._signals[name] for name in _IMU) if has_imu else ()
        self._period_ns = period_ns
        self._period_s = period_ns / 1e9
        self._tilt = self._make_tilt()
        self._gravity = self._make_gravity()
        self.residual = self._make_residual(sends)
        self._checks: tuple[Check, ...] = tuple(self._make_checks())
        self.needs: tuple[int, ...] = tuple(
            sorted({*used, *(index for check in self._checks for index in check.needs)})
        )
        self.faults: Sequence[str] = ()
        self.elapsed_s = self._period_s
        limit = settings.late_cycles_limit
        self._deadlines = None if limit is None else DeadlineWatch(limit, period_ns)
        self._deadline_ns: int | None = None
        self._start_ns: int | None = None
        self._rate = RateMeter(period_ns)
        still = settings.checklist or (ChecklistSettings() if settings.posture else None)
        self._still = StillWatch(self._imu, still.still_rate, still.still_acceleration) if still and has_imu else None
        self._lies_for = periods_in(LIES_FOR_S, self._period_s)
        self.body = Body(None, is_still=False)

    def look(  # noqa: PLR0913, PLR0917 - what there is of a cycle, in one call, since it is made in each
        self,
        values: Sequence[float],
        valid: Sequence[bool],
        start_ns: int,
        lateness_ns: int,
        setpoint: tuple[float, float] | None = None,
        sent: Sequence[float] = (),
        *,
        balances: bool = False,
    ) -> Sequence[str]:
        """Take a cycle.

        Args:
            values: Newest value of each signal, SI.
            valid: Whether each is fresh enough to be used.
            start_ns: When the cycle started, ns, monotonic.
            lateness_ns: How long after its deadline that was, ns.
            setpoint: What the robot followed in the cycle before, m/s and rad/s; None where it had to follow nothing.
            sent: The commands that left in this cycle, which `residual` needs, and `gravity` too.
            balances: Whether the robot does, and neither stands up nor lies.

        Returns:
            What is wrong; each of it is a reason to take the torque away.
        """
        # Values are as new as the cycle that reads them, however many deadlines there were.
        elapsed_s = self._period_s if self._start_ns is None else (start_ns - self._start_ns) * 1e-9
        self.elapsed_s = elapsed_s
        self._start_ns = start_ns
        periods = max(round(elapsed_s / self._period_s), 1)
        view = View(values, valid, periods, setpoint, elapsed_s, balances=balances, sent=sent)
        faults: list[str] = []
        for check in self._checks:
            fault = check.look(view)
            if fault is not None:
                faults.append(fault)
        if self._deadlines is not None:
            last_ns, self._deadline_ns = self._deadline_ns, start_ns - lateness_ns
            periods = 1 if last_ns is None else max(round((self._deadline_ns - last_ns) / self._period_ns), 1)
            missed = self._deadlines.look(periods, lateness_ns)
            if missed is not None:
                faults.append(missed)
        self._rate.mark(start_ns)
        if self._still is not None:
            self._still.look(view)
        if self._settings.posture is not None and self._tilt is not None:
            self.body = Body(self._tilt.estimate.tilt, self._is_still(values), view.periods)
        if self.residual is not None:
            self.residual.look(view)
        self.faults = faults
        return faults

    @property
    def imu_is_credible(self) -> bool:
        """Whether the newest sample of the IMU goes with gravity and those before, as far as that is watched."""
        return self._gravity is None or self._gravity.is_credible

    def checklist(
        self,
        values: Sequence[float],
        ages: Sequence[float],
        valid: Sequence[bool],
        *,
        real_time: bool | None,
        unseen: Sequence[str] = (),
    ) -> Sequence[PreArmCheck]:
        """The pre-arm checks, where the robot has any.

        `real_time` is whether the loop has real-time priority; `unseen` is what drives measure only with motors on.
        """
        if self._settings.checklist is None:
            return ()
        names, supply = list(self._signals), self._supply
        needs = [index for index in self.needs if names[index] not in unseen]
        stale = [names[index] for index in needs if not valid[index]]
        measured = PreArmMeasurements(
            wanted_hz=self._rate.wanted_hz,
            rate_hz=self._rate.rate_hz,
            newest_age_s=min([ages[index] for index in needs], default=None),
            has_fresh=len(stale) < len(needs),
            stale=stale,
            faults=self.faults,
            still_s=self._still.periods * self._period_s if self._still else None,
            tilt=self._tilt.estimate.tilt if self._tilt else None,
            wheels=[values[index] for index in self._wheels if names[index] not in unseen],
            unseen=[names[index] for index in self.needs if names[index] in unseen],
            supply_v=values[supply] if supply is not None and valid[supply] else None,
            real_time=real_time,
        )
        return list(pre_arm_checks(self._settings.checklist, self._settings.supply, measured))

    def _is_still(self, values: Sequence[float]) -> bool:
        """Whether body and wheels have been still for a while."""
        if self._still is None or self._still.periods < self._lies_for:
            return False
        return all([abs(values[wheel]) <= MOVING for wheel in self._wheels])  # noqa: C419 - a generator takes longer

    def _make_tilt(self) -> TiltWatch | None:
        settings = self._settings
        wanted = {
            "posture": settings.posture,
            "tilt_limit_rad": settings.tilt_limit_rad,
            "tilt_rate_limit": settings.tilt_rate_limit,
        }
        key = next((key for key, value in wanted.items() if value is not None), "")
        if not key and (settings.checklist is None or not self._imu):
            return None
        return TiltWatch(self._places(key, _IMU), self._period_s, settings.tilt_limit_rad, settings.tilt_rate_limit)

    def _make_gravity(self) -> GravityCheck | None:
        settings = self._settings.gravity
        if settings is None:
            return None
        left, right, gyro, x, z = self._places("gravity", (*self._of_wheels[0], _IMU[1], _IMU[3], _IMU[5]))
        return GravityCheck((left, right), (gyro, x, z), settings, self._period_s)

    def _make_residual(self, commands: Sequence[str]) -> ResidualMonitor | None:
        settings = self._settings.residual
        if settings is None:
            return None
        left, right, gyro, x = self._places("residual", (*self._of_wheels[0], _IMU[1], _IMU[3]))
        sent = command_places(settings, commands if self._settings.posture else ())
        return ResidualMonitor((left, right), (gyro, x), sent, settings, self._period_s)

    @property
    def _of_wheels(self) -> list[tuple[str, str]]:
        """The velocities of each pair of wheels."""
        return [(f"{left}{_VELOCITY}", f"{right}{_VELOCITY}") for left, right in self._pairs]

    def _make_checks(self) -> Iterator[Check]:
        settings, period_s = self._settings, self._period_s
        yield from (check for check in (self._tilt, self._gravity) if check is not None)
        yield from self._make_ranges()
        yield from self._make_frozen()
        yaw, velocity, following = settings.yaw_consistency, settings.velocity_consistency, settings.following_error
        if yaw is not None:
            for pair in self._of_wheels:
                left, right, gyro = self._places("yaw_consistency", (*pair, _GYRO[2]))
                yield YawAgreement(left, right, gyro, yaw, period_s)
        if velocity is not None:
            for axis in self._axes or _SIDES:
                angle, speed = self._places("velocity_consistency", (f"{axis}.angle", f"{axis}{_VELOCITY}"))
                yield VelocityAgreement(axis, angle, speed, velocity, period_s)
        for pair in self._of_wheels:
            if following is not None:
                left, right = self._places("following_error", pair)
                yield FollowingError(left, right, following, period_s)
            if settings.runaway is not None:
                left, right = self._places("runaway", pair)
                yield Runaway(left, right, settings.runaway, period_s)

    def _make_ranges(self) -> Iterator[Check]:
        limit, supply = self._settings.wheel_velocity_limit, self._settings.supply
        if limit is not None:
            for name in [f"{axis}{_VELOCITY}" for axis in self._axes or _SIDES]:
                yield WheelSpeed(name, self._place("wheel_velocity_limit", name), -limit, limit, "rad/s")
        for axis, joint in (self._settings.joint_limits or {}).items():
            name = f"{axis}.angle"
            yield RangeCheck(name, self._place(f"joint_limits.{axis}", name), joint.min_rad, joint.max_rad, "rad")
        if supply is not None:
            yield RangeCheck(_SUPPLY, self._place("supply", _SUPPLY), supply.min_v, supply.max_v, "V")

    def _make_frozen(self) -> Iterator[Check]:
        if self._settings.frozen_after_s is None:
            return
        periods = periods_in(self._settings.frozen_after_s, self._period_s)
        has = self._signals
        for axis in self._axes:
            names = (f"{axis}.angle", f"{axis}{_VELOCITY}")
            if names[0] in has:
                yield Frozen(f"the {axis} encoder", [has[name] for name in names], periods, [has[names[1]]])
        if self._imu:
            wheels = None if self._settings.imu_is_noisy else self._wheels
            yield Frozen("the IMU", self._imu, periods, wheels)

    def _places(self, key: str, names: Iterable[str]) -> tuple[int, ...]:
        return tuple(self._place(key, name) for name in names)

    def _place(self, key: str, name: str) -> int:
        if name not in self._signals:
            raise ConfigurationError(
                f"safety.{key} needs '{name}', which this robot does not measure; leave {key} out, or add what "
                f"measures it; there is {', '.join(self._signals) or 'nothing'}"
            )
        return self._signals[name]
