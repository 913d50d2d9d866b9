# SPDX-License-Identifier: MIT
"""Pre-arm checks: what must pass before the robot arms, what was measured, and the remedy where it fails."""

from collections.abc import Iterator, Sequence

from segway_ecc.firmware_io.value import Value
from segway_ecc.node.safety.settings import ChecklistSettings, SupplyWindow


class PreArmMeasurements(Value, frozen=True):
    """What was measured; None for what the robot does not have, or what is not known yet.

    Attributes:
        rate_hz: The rate of the last second.
        newest_age_s: Age of the newest of the values that are needed, s.
        has_fresh: Whether any of them is fresh enough to be used.
        stale: The signals that are needed and too old.
        faults: What the checks of sensors and deadlines found.
        still_s: For how long the IMU has been still, s; None only where there is no IMU.
        tilt: From upright, rad.
        wheels: Velocities, rad/s, of those wheels of which they are measured.
        unseen: The signals that are needed and that drives measure only once the motors are on.
        real_time: Whether the loop has real-time priority.
    """

    wanted_hz: float
    rate_hz: float | None = None
    newest_age_s: float | None = None
    has_fresh: bool = False
    stale: Sequence[str] = ()
    faults: Sequence[str] = ()
    still_s: float | None = None
    tilt: float | None = None
    wheels: Sequence[float] = ()
    unseen: Sequence[str] = ()
    supply_v: float | None = None
    real_time: bool | None = None


class PreArmCheck(Value, frozen=True):
    """The outcome of one check; with a warning the robot may arm all the same.

    The text is what was measured, and what to do where that is not enough.
    """

    name: str
    passed: bool
    text: str
    is_warning: bool = False

    @property
    def refuses(self) -> bool:
        """Whether it keeps the robot from arming."""
        return not (self.passed or self.is_warning)

    def __str__(self) -> str:
        """As diagnostics show it."""
        if self.passed:
            return f"ok: {self.text}"
        return f"{'warning' if self.is_warning else 'refused'}: {self.text}"


def pre_arm_checks(
    settings: ChecklistSettings, supply: SupplyWindow | None, measured: PreArmMeasurements
) -> Iterator[PreArmCheck]:
    """Go through the checks; those of what the robot does not have are left out."""
    wanted, rate, age, volts = measured.wanted_hz, measured.rate_hz, measured.newest_age_s, measured.supply_v
    if rate is None:
        yield PreArmCheck("rate", passed=False, text="not measured for a second yet; wait")
    else:
        yield _check(
            "rate",
            f"{rate:.2f} Hz of {wanted:g} Hz over the last second",
            "give the loop real-time priority, end other programs, or take a longer step",
            passed=abs(rate - wanted) <= settings.rate_tolerance * wanted,
        )
    if age is not None:
        remedy = "look at the bus, its bit rate and termination, and the drives' supply"
        yield _check("telemetry", f"the newest value is {age * 1e3:.1f} ms old", remedy, passed=measured.has_fresh)
    text = f"too old: {', '.join(measured.stale)}" if measured.stale else "all values are fresh"
    yield _check("sensors", text, "see that each device is on and sends", passed=not measured.stale)
    text = ", ".join(measured.faults) or "nothing against sensors and deadlines"
    yield _check("plausible", text, "remedy it, or wait until it has passed", passed=not measured.faults)
    if measured.unseen:
        text = f"not measured before the motors are on: {', '.join(measured.unseen)}; see that the wheels are at rest"
        yield PreArmCheck("unseen", passed=False, text=text, is_warning=True)
    yield from _motion_checks(settings, measured)
    if supply is not None and volts is not None:
        text = f"{volts:.1f} V, allowed is {supply.min_v:g} to {supply.max_v:g} V"
        yield _check("supply", text, "charge or change the battery", passed=supply.min_v <= volts <= supply.max_v)
    if measured.real_time is not None:
        text = "granted" if measured.real_time else "not granted; run as root, or raise the limit: ulimit -r"
        yield PreArmCheck("real_time", measured.real_time, text, is_warning=True)


def _motion_checks(settings: ChecklistSettings, measured: PreArmMeasurements) -> Iterator[PreArmCheck]:
    """The robot is at rest and upright."""
    still_s, tilt = measured.still_s, measured.tilt
    if still_s is not None:
        yield _check(
            "imu_still",
            f"still for {still_s:.2f} s of {settings.still_s:g} s",
            f"hold the robot still (below {settings.still_rate:g} rad/s, and {settings.still_acceleration:g} m/s2 "
            "from gravity), or see how the IMU is mounted",
            passed=still_s >= settings.still_s,
        )
        if tilt is None:
            yield PreArmCheck("tilt", passed=False, text="not measured; see that the IMU sends")
        else:
            text = f"{tilt:.2f} rad from upright, allowed is {settings.tilt_rad:g} rad"
            yield _check("tilt", text, "hold the robot upright", passed=tilt <= settings.tilt_rad)
    if measured.wheels:
        fastest = max(map(abs, measured.wheels))
        text = f"the faster turns at {fastest:.2f} rad/s, allowed is {settings.wheel_velocity:g} rad/s"
        yield _check("wheels_still", text, "let the wheels come to rest", passed=fastest <= settings.wheel_velocity)


def drives_check(reasons: Sequence[str]) -> PreArmCheck:
    """Whether the drives are fit to arm, as they report: `reasons` against it, each with its remedy."""
    return PreArmCheck("drives", not reasons, "; ".join(reasons) or "no reason against it")


def commissioned_check(reason: str) -> PreArmCheck:
    """The robot's file requires a commissioning, and for this `reason` it counts as not commissioned."""
    return _check("commissioned", reason, "run segway-ecc design commission", passed=False)


def model_check(fault: str) -> PreArmCheck:
    """What the model gives that the robot cannot do: it was started anew, and gives it again."""
    return _check("model", fault, "see its parameters and what it is wired to", passed=False)


def failed_checks(checks: Sequence[PreArmCheck]) -> list[str]:
    """What keeps the robot from arming."""
    return [f"{check.name}: {check.text}" for check in checks if check.refuses]


def _check(name: str, text: str, remedy: str, *, passed: bool) -> PreArmCheck:
    return PreArmCheck(name, passed, text if passed else f"{text}; {remedy}")
