"""What must hold before the robot arms: each item says what was measured, and if it refuses, how to mend it."""

from collections.abc import Sequence

from segway_ecc.firmware_io.value import Value
from segway_ecc.node.safety.settings import ChecklistSettings, SupplyWindow


class PreArmMeasurements(Value, frozen=True):
    """What was measured; None for what the robot does not have, or what is not known yet.

    Attributes:
        wanted_hz: The rate that the loop should have.
        rate_hz: The rate of the last second.
        newest_age_s: Age of the newest of the values that are needed, s.
        has_fresh: Whether any of them is fresh enough to be used.
        stale: The signals that are needed and too old.
        faults: What the checks of the sensors and deadlines say.
        still_s: For how long the IMU has been still, s; None only where there is no IMU.
        tilt: From upright, rad.
        wheels: Velocities, rad/s.
        supply_v: V.
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
    supply_v: float | None = None
    real_time: bool | None = None


class PreArmCheck(Value, frozen=True):
    """One item of the list.

    Attributes:
        name: What it is about.
        passed: Whether it passed.
        text: What was measured, and what to do where that is not enough.
        is_warning: Whether the robot may arm all the same.
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
) -> list[PreArmCheck]:
    """Go through the list; items about what the robot does not have are left out."""
    items = [
        _rate(settings, measured),
        _telemetry(measured),
        _sensors(measured),
        _plausible(measured),
        _still(settings, measured),
        _tilt(settings, measured),
        _wheels(settings, measured),
        _supply(supply, measured),
        _real_time(measured),
    ]
    return [item for item in items if item is not None]


def drives_check(reasons: Sequence[str]) -> PreArmCheck:
    """The drives' own word on arming: `reasons` against it, each of which says how to mend it."""
    return PreArmCheck("drives", not reasons, "; ".join(reasons) or "nothing speaks against it")


def failed_checks(items: Sequence[PreArmCheck]) -> list[str]:
    """What keeps the robot from arming."""
    return [f"{item.name}: {item.text}" for item in items if item.refuses]


def _item(name: str, text: str, mend: str, *, passed: bool) -> PreArmCheck:
    return PreArmCheck(name, passed, text if passed else f"{text}; {mend}")


def _rate(settings: ChecklistSettings, measured: PreArmMeasurements) -> PreArmCheck:
    wanted, rate = measured.wanted_hz, measured.rate_hz
    if rate is None:
        return _item("rate", "not measured for a second yet", "wait", passed=False)
    return _item(
        "rate",
        f"{rate:.2f} Hz of {wanted:g} Hz over the last second",
        "give the loop real-time priority, end other programs, or take a longer step",
        passed=abs(rate - wanted) <= settings.rate_tolerance * wanted,
    )


def _telemetry(measured: PreArmMeasurements) -> PreArmCheck | None:
    age = measured.newest_age_s
    if age is None:
        return None
    return _item(
        "telemetry",
        f"the newest value is {age * 1e3:.1f} ms old",
        "look at the bus, its bit rate and termination, and the drives' supply",
        passed=measured.has_fresh,
    )


def _sensors(measured: PreArmMeasurements) -> PreArmCheck:
    text = f"too old: {', '.join(measured.stale)}" if measured.stale else "all values are fresh"
    return _item("sensors", text, "see that each device is on and sends", passed=not measured.stale)


def _plausible(measured: PreArmMeasurements) -> PreArmCheck:
    text = ", ".join(measured.faults) or "nothing against sensors and deadlines"
    return _item("plausible", text, "mend it, or wait until it has passed", passed=not measured.faults)


def _still(settings: ChecklistSettings, measured: PreArmMeasurements) -> PreArmCheck | None:
    still_s = measured.still_s
    if still_s is None:
        return None
    return _item(
        "imu_still",
        f"still for {still_s:.2f} s of {settings.still_s:g} s",
        f"hold the robot still (below {settings.still_rate:g} rad/s, and {settings.still_acceleration:g} m/s2 "
        "from gravity), or see how the IMU is mounted",
        passed=still_s >= settings.still_s,
    )


def _tilt(settings: ChecklistSettings, measured: PreArmMeasurements) -> PreArmCheck | None:
    tilt = measured.tilt
    if measured.still_s is None:
        return None
    if tilt is None:
        return _item("tilt", "not measured", "see that the IMU sends", passed=False)
    return _item(
        "tilt",
        f"{tilt:.2f} rad from upright, allowed is {settings.tilt_rad:g} rad",
        "hold the robot upright",
        passed=tilt <= settings.tilt_rad,
    )


def _wheels(settings: ChecklistSettings, measured: PreArmMeasurements) -> PreArmCheck | None:
    if not measured.wheels:
        return None
    fastest = max(map(abs, measured.wheels))
    return _item(
        "wheels_still",
        f"the faster turns at {fastest:.2f} rad/s, allowed is {settings.wheel_velocity:g} rad/s",
        "let the wheels come to rest",
        passed=fastest <= settings.wheel_velocity,
    )


def _supply(supply: SupplyWindow | None, measured: PreArmMeasurements) -> PreArmCheck | None:
    volts = measured.supply_v
    if supply is None or volts is None:
        return None
    return _item(
        "supply",
        f"{volts:.1f} V, allowed is {supply.min_v:g} to {supply.max_v:g} V",
        "charge or change the battery",
        passed=supply.min_v <= volts <= supply.max_v,
    )


def _real_time(measured: PreArmMeasurements) -> PreArmCheck | None:
    if measured.real_time is None:
        return None
    text = "granted" if measured.real_time else "not granted; run as root, or raise the limit: ulimit -r"
    return PreArmCheck("real_time", measured.real_time, text, is_warning=True)


def no_checks() -> Sequence[PreArmCheck]:
    """Of a robot that has no list."""
    return ()
