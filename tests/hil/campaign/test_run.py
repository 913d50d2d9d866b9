# SPDX-License-Identifier: MIT
"""Scenarios run in lock step: what is detected, when the motors are off, and the same bits every time."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
import pytest

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioResult, ScenarioRun, load_scenario
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.faults.fault import Fault, Target, Type
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.sequence.manoeuvre import Segment

PERIOD_S = 0.01
WATCHDOG_S = 0.05
"""Of the loop of cart-can, and of its drives."""
SEGMENTS = (Segment(linear=1.0, angular=0.5, duration=0.8), Segment(linear=0.4, angular=-0.5, duration=0.8))


def run(
    *faults: Fault,
    robot: str = "cart-can",
    seed: int = 0,
    fallback: bool = False,
    log: Path | None = None,
    **more: float,
) -> ScenarioResult:
    scenario = Scenario(
        name="test",
        robot=robot,
        segments=SEGMENTS,
        faults=faults,
        fallback=fallback,
        expect=Expectation(outcome="drives_on"),
    )
    parameters: Mapping[str, float] = {name.replace("__", "."): value for name, value in more.items()}
    return run_scenario(ScenarioRun("test", scenario, robot, seed, parameters), log)


def fault(
    target: Target, kind: Type, at_s: float = 0.5, for_s: float | None = None, amount: float | None = None
) -> Fault:
    return Fault(target=target, type=kind, at_s=at_s, for_s=for_s, amount=amount)


def test_without_a_fault_the_robot_drives_on() -> None:
    result = run()
    assert (result.outcome, result.reason, result.detection_s, result.max_distance_m) == ("drives_on", "", None, 0.0)
    assert result.max_tilt_rad is None
    assert result.simulated_s > 1.6


def test_a_cut_bus_is_a_fault_and_the_watchdog_ends_the_torque() -> None:
    result = run(fault("can", "off"))
    assert result.outcome == "faults"
    assert "left.velocity is too old" in result.reason
    # Three periods of age, one to see it, one for where in the period the cut was.
    assert result.detection_s is not None
    assert PERIOD_S <= result.detection_s <= 5 * PERIOD_S
    assert result.safe_s is not None
    assert 0.03 <= result.safe_s <= WATCHDOG_S + PERIOD_S
    assert result.max_distance_m > 0.1


def test_the_serial_line_carries_the_robot_on() -> None:
    result = run(fault("can", "off"), fallback=True)
    assert result.outcome == "drives_on"
    assert result.switches == (result.reason,)
    assert result.reason.startswith("no good frame for ")
    assert result.safe_s is None
    assert 0.0 < result.max_distance_m < 0.05


def test_both_lines_lost_is_a_fault() -> None:
    assert run(fault("can", "off"), fault("serial", "off"), fallback=True).outcome == "faults"


def test_lost_set_points_are_a_hold_that_ends_with_them() -> None:
    result = run(fault("command_link", "off", at_s=0.05))
    assert result.outcome == "holds"
    # The last one was said at 0 s; the time-out is 0.5 s.
    assert result.detection_s == pytest.approx(0.45, abs=3 * PERIOD_S)
    assert run(fault("command_link", "off", at_s=0.05, for_s=0.4)).outcome == "drives_on"


def test_a_killed_node_leaves_the_rest_to_the_watchdogs() -> None:
    result = run(fault("process", "off"))
    assert (result.outcome, result.detection_s) == ("faults", None)
    assert result.safe_s is not None
    # A node that closes what it has sends zero at once; one that was killed does not.
    assert 0.03 <= result.safe_s <= WATCHDOG_S + PERIOD_S
    assert result.simulated_s == pytest.approx(run().simulated_s, abs=2 * PERIOD_S)


def test_motors_that_are_still_on_at_the_end_are_not_safe() -> None:
    result = run(fault("process", "off", at_s=1.58))  # the run ends at 1.6 s, before the watchdog acts
    assert (result.outcome, result.safe_s) == ("unsafe", None)


def test_a_node_killed_on_two_lines_is_as_dead() -> None:
    result = run(fault("process", "off"), fallback=True)
    assert result.safe_s is not None
    assert 0.03 <= result.safe_s <= WATCHDOG_S + PERIOD_S


def test_a_node_killed_on_the_serial_line_sends_nothing_there_either() -> None:
    result = run(fault("can", "off", at_s=0.3), fault("process", "off", at_s=0.8), fallback=True)
    assert result.safe_s is not None
    assert 0.5 + 0.03 <= result.safe_s <= 0.5 + WATCHDOG_S + PERIOD_S


def test_a_stalled_node_finds_its_motors_off() -> None:
    result = run(fault("process", "stuck", amount=0.2))
    assert result.outcome == "faults"
    assert result.detection_s == pytest.approx(0.2, abs=2 * PERIOD_S)


@pytest.mark.parametrize(("kind", "amount"), [("wrong", 3600.0), ("wrong", -3600.0), ("stuck", None), ("slow", 0.1)])
def test_the_wall_clock_moves_no_motor(kind: Type, amount: float | None) -> None:
    assert run(fault("clock", kind, amount=amount)).digest == run().digest


def test_a_disturbed_sensor_and_a_motor_move_the_robot_off_its_way() -> None:
    for result in (run(fault("encoder", "off")), run(fault("right_motor", "wrong"))):
        assert result.max_distance_m > 0.3


def test_a_slow_disk_makes_the_cycles_late_and_no_more() -> None:
    result = run(fault("disk", "slow", amount=0.002))
    assert result.outcome == "drives_on"
    assert 0.0 <= result.max_distance_m < 0.01


def test_a_disk_that_fails_moves_no_motor_and_the_run_is_seen_to_its_end() -> None:
    result = run(fault("disk", "off"), fault("can", "off", at_s=1.3))
    alone = run(fault("can", "off", at_s=1.3))
    assert (result.outcome, result.digest) == ("faults", alone.digest)
    assert "left.velocity is too old" in result.reason


def test_a_motor_that_is_off_is_detected_at_the_next_setpoint() -> None:
    result = run(fault("left_motor", "off"), robot="cart-odrive")
    assert result.outcome == "faults"
    assert result.reason.startswith("the robot goes ")
    # From 0.8 s on it is told to turn the other way; it must be wrong for a quarter of a second.
    assert result.detection_s == pytest.approx(0.3 + 0.25, abs=0.1)


def test_the_same_seed_gives_the_same_bits_and_another_seed_others() -> None:
    same = [run(fault("can", "intermittent", amount=0.3), seed=5) for _ in range(2)]
    assert same[0] == same[1]
    assert same[0].digest != run(fault("can", "intermittent", amount=0.3), seed=6).digest


@pytest.mark.parametrize("robot", ["cart-odrive", "segway-odrive"])
def test_devices_that_sleep_through_passes_change_no_bit(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    faults = (fault("imu", "wrong", for_s=0.02, amount=0.1), fault("can", "off", at_s=1.0, for_s=0.2))
    asleep = run(*faults, robot=robot)
    monkeypatch.setattr(SimulatedRobot, "_all_sleep", lambda *_: False)
    assert run(*faults, robot=robot) == asleep


def test_parameters_reach_model_and_plant() -> None:
    plain = run()
    for result in (run(plant__Inertia=0.003), run(model__FeedbackGain=0.05)):
        assert result.digest != plain.digest
        assert result.max_distance_m == 0.0  # of the robot with the same parameters
    assert run(plant__Inertia=2.0e-3).digest == plain.digest  # what it is anyway


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="Weight"):
        run(plant__Weight=1.0)
    with pytest.raises(UnknownNameError, match="Weight"):
        run(model__Weight=1.0)
    with pytest.raises(ConfigurationError, match="the drives of robot 'cart-cia402' have no serial line"):
        run(robot="cart-cia402", fallback=True)
    with pytest.raises(NoSimulationError, match="robot 'cart' has no hardware"):
        run(robot="cart")


def test_the_robots_log_is_written(tmp_path: Path) -> None:
    run(log=tmp_path / "run.mcap")
    assert (tmp_path / "run.mcap").read_bytes().startswith(b"\x89MCAP0")


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        ("can-cut", "cart-odrive"),
        ("can-cut", "cart-vesc"),
        ("can-cut", "cart-cia402"),
        ("can-cut-with-fallback", "cart-vesc"),
        ("can-corrupted", "cart-can"),
        ("can-repeats", "cart-odrive"),
        ("commands-not-finite", "cart-cia402"),
        ("battery-off", "cart-can"),
        ("node-killed", "cart-odrive"),
        ("serial-noise", "cart-odrive"),
    ],
)
def test_a_few_of_the_packages_scenarios_come_as_expected(name: str, robot: str) -> None:
    scenario = load_scenario(name)
    result = run_scenario(ScenarioRun(name, scenario, robot, 1, {}))
    assert result.why_not == ()
    assert msgspec.structs.replace(result, why_not=()) == result
