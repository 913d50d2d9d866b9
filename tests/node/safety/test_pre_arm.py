# SPDX-License-Identifier: MIT
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from segway_ecc.node.safety.pre_arm import (
    PreArmCheck,
    PreArmMeasurements,
    commissioned_check,
    drives_check,
    failed_checks,
    model_check,
    pre_arm_checks,
)
from segway_ecc.node.safety.settings import ChecklistSettings, SupplyWindow

GOOD = PreArmMeasurements(
    wanted_hz=200.0,
    rate_hz=199.98,
    newest_age_s=0.004,
    has_fresh=True,
    still_s=0.5,
    tilt=0.1,
    wheels=(0.1, -0.2),
    supply_v=25.0,
    real_time=True,
)
SUPPLY = SupplyWindow(min_v=22.0, max_v=29.0)


def run(measured: PreArmMeasurements) -> dict[str, PreArmCheck]:
    return {item.name: item for item in pre_arm_checks(ChecklistSettings(), SUPPLY, measured)}


def test_fit_robot_passes_every_check_with_what_was_measured() -> None:
    assert {name: str(item) for name, item in run(GOOD).items()} == {
        "rate": "ok: 199.98 Hz of 200 Hz over the last second",
        "telemetry": "ok: the newest value is 4.0 ms old",
        "sensors": "ok: all values are fresh",
        "plausible": "ok: nothing against sensors and deadlines",
        "imu_still": "ok: still for 0.50 s of 0.5 s",
        "tilt": "ok: 0.10 rad from upright, allowed is 0.2 rad",
        "wheels_still": "ok: the faster turns at 0.20 rad/s, allowed is 0.5 rad/s",
        "supply": "ok: 25.0 V, allowed is 22 to 29 V",
        "real_time": "ok: granted",
    }
    assert failed_checks(list(run(GOOD).values())) == []


MEND_RATE = "give the loop real-time priority, end other programs, or take a longer step"
MEND_STILL = "hold the robot still (below 0.1 rad/s, and 0.5 m/s2 from gravity), or see how the IMU is mounted"
MEND_BUS = "look at the bus, its bit rate and termination, and the drives' supply"
REFUSALS: dict[str, tuple[PreArmMeasurements, str]] = {
    "slow": (replace(GOOD, rate_hz=189.9), f"rate: 189.90 Hz of 200 Hz over the last second; {MEND_RATE}"),
    "fast": (replace(GOOD, rate_hz=210.1), f"rate: 210.10 Hz of 200 Hz over the last second; {MEND_RATE}"),
    "young": (replace(GOOD, rate_hz=None), "rate: not measured for a second yet; wait"),
    "silent": (
        replace(GOOD, newest_age_s=0.0151, has_fresh=False),
        f"telemetry: the newest value is 15.1 ms old; {MEND_BUS}",
    ),
    "stale": (
        replace(GOOD, stale=("left.angle", "left.velocity")),
        "sensors: too old: left.angle, left.velocity; see that each device is on and sends",
    ),
    "implausible": (
        replace(GOOD, faults=("the IMU is frozen", "lopsided")),
        "plausible: the IMU is frozen, lopsided; remedy it, or wait until it has passed",
    ),
    "held": (replace(GOOD, still_s=0.49), f"imu_still: still for 0.49 s of 0.5 s; {MEND_STILL}"),
    "leaning": (
        replace(GOOD, tilt=0.21),
        "tilt: 0.21 rad from upright, allowed is 0.2 rad; hold the robot upright",
    ),
    "no tilt": (replace(GOOD, tilt=None), "tilt: not measured; see that the IMU sends"),
    "rolling": (
        replace(GOOD, wheels=(0.1, -0.51)),
        "wheels_still: the faster turns at 0.51 rad/s, allowed is 0.5 rad/s; let the wheels come to rest",
    ),
    "empty": (
        replace(GOOD, supply_v=21.9),
        "supply: 21.9 V, allowed is 22 to 29 V; charge or change the battery",
    ),
    "wrong charger": (
        replace(GOOD, supply_v=29.1),
        "supply: 29.1 V, allowed is 22 to 29 V; charge or change the battery",
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_failed_check_has_what_was_measured_and_the_remedy(name: str) -> None:
    measured, text = REFUSALS[name]
    items = run(measured)
    assert failed_checks(list(items.values())) == [text]
    item, _, told = text.partition(": ")
    assert str(items[item]) == f"refused: {told}"


AT_THE_BOUND: list[PreArmMeasurements] = [
    replace(GOOD, rate_hz=190.0),
    replace(GOOD, rate_hz=210.0),
    replace(GOOD, newest_age_s=9.0),  # of a drive that sends that seldom
    replace(GOOD, tilt=0.2),
    replace(GOOD, wheels=(-0.5, 0.5)),
    replace(GOOD, supply_v=22.0),
    replace(GOOD, supply_v=29.0),
]


@pytest.mark.parametrize("measured", AT_THE_BOUND)
def test_a_bound_itself_is_still_good(measured: PreArmMeasurements) -> None:
    assert failed_checks(list(run(measured).values())) == []


def test_every_failed_check_is_listed_in_order() -> None:
    worst = replace(GOOD, rate_hz=None, stale=("left.angle",), tilt=1.0, supply_v=1.0)
    names = [text.partition(":")[0] for text in failed_checks(list(run(worst).values()))]
    assert names == ["rate", "sensors", "tilt", "supply"]


def test_no_real_time_priority_is_a_warning_only() -> None:
    item = run(replace(GOOD, real_time=False))["real_time"]
    assert str(item) == "warning: not granted; run as root, or raise the limit: ulimit -r"
    assert not item.refuses


LEFT_OUT: list[tuple[Callable[[], dict[str, PreArmCheck]], set[str]]] = [
    (lambda: run(PreArmMeasurements(wanted_hz=100.0, rate_hz=100.0)), {"rate", "sensors", "plausible"}),
    (lambda: run(replace(GOOD, still_s=None, tilt=None)), set(run(GOOD)) - {"imu_still", "tilt"}),
    (lambda: run(replace(GOOD, supply_v=None)), set(run(GOOD)) - {"supply"}),
    (
        lambda: {item.name: item for item in pre_arm_checks(ChecklistSettings(), None, GOOD)},
        set(run(GOOD)) - {"supply"},
    ),
]


@pytest.mark.parametrize(("items", "names"), LEFT_OUT)
def test_what_the_robot_does_not_have_is_left_out(items: Callable[[], dict[str, PreArmCheck]], names: set[str]) -> None:
    assert set(items()) == names


def test_nothing_is_taken_for_granted_that_was_not_measured() -> None:
    blank = PreArmMeasurements(wanted_hz=100.0)
    assert (blank.still_s, blank.tilt, blank.real_time) == (None, None, None)
    assert not blank.has_fresh
    assert failed_checks(list(run(replace(blank, still_s=0.0)).values()))[1:] == [
        f"imu_still: still for 0.00 s of 0.5 s; {MEND_STILL}",
        "tilt: not measured; see that the IMU sends",
    ]


def test_failed_check_refuses_unless_it_is_a_warning() -> None:
    assert PreArmCheck("x", passed=False, text="").refuses


def test_drives_that_have_nothing_against_arming_are_an_item_that_holds() -> None:
    item = drives_check(())
    assert (item.name, str(item), item.refuses) == ("drives", "ok: no reason against it", False)


def test_drives_keep_the_robot_from_arming_with_every_reason_of_theirs() -> None:
    item = drives_check(("left: no supply; switch it on", "right: too hot; wait"))
    assert failed_checks([item]) == ["drives: left: no supply; switch it on; right: too hot; wait"]
    assert str(item) == "refused: left: no supply; switch it on; right: too hot; wait"


def test_a_robot_that_is_not_commissioned_does_not_arm_and_has_the_remedy() -> None:
    item = commissioned_check("its report is of another file")
    remedy = "run segway-ecc design commission"
    assert failed_checks([item]) == [f"commissioned: its report is of another file; {remedy}"]


def test_a_model_that_asks_for_what_no_robot_can_do_keeps_it_from_arming() -> None:
    item = model_check("'left' is 99 N m")
    assert failed_checks([item]) == ["model: 'left' is 99 N m; see its parameters and what it is wired to"]


@pytest.mark.parametrize("value", [GOOD, drives_check(())])
def test_what_was_measured_and_found_stays_as_it_is(value: PreArmMeasurements | PreArmCheck) -> None:
    for name in value.__struct_fields__:
        with pytest.raises(AttributeError):
            setattr(value, name, getattr(value, name))


def test_what_is_measured_only_with_the_motors_on_is_a_warning_that_names_it() -> None:
    item = run(replace(GOOD, wheels=(), unseen=("left.angle", "left.velocity")))["unseen"]
    assert str(item) == (
        "warning: not measured before the motors are on: left.angle, left.velocity; see that the wheels are at rest"
    )
    assert not item.refuses
