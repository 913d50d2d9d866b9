# SPDX-License-Identifier: MIT
"""The drives' own limits: read back where a driver reports them, else looked up by the person and confirmed."""

import math

import pytest

from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.drives.moteus.settings import MoteusAxisSettings, MoteusSettings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings, OdriveWheelSettings
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.commission.drive_limits import _LOOKUPS, drive_limits
from segway_ecc.hil.commission.expected import expected_of
from segway_ecc.hil.commission.person import Answer
from segway_ecc.hil.commission.safety_steps import limits
from segway_ecc.hil.commission.session import StepRefusedError
from segway_ecc.hil.commission.simulated import SimulatedSite
from segway_ecc.node.config import load_robot

FASTEST = 10.0 * math.tau
"""Ten turns of a wheel a second, rad/s."""


def odrive_wheel(node_id: int, axis: int) -> OdriveWheelSettings:
    """A wheel of 2 N m behind a gear of 4."""
    return OdriveWheelSettings(node_id=node_id, axis=axis, max_torque=2.0, gear_ratio=4.0, torque_constant=0.05)  # type: ignore[arg-type]  # 0 or 1


def vesc() -> VescSettings:
    """Two controllers that need 10 A and 42,000 electrical rpm."""
    left, right = (
        VescWheelSettings(controller_id=number, pole_pairs=7, torque_constant=0.1, max_torque=10.0, gear_ratio=10.0)
        for number in (1, 2)
    )
    return VescSettings(axes={"left": left, "right": right}, timeout_set_s=0.05)


def test_wheel_board_reports_all_that_it_has() -> None:
    found = drive_limits(WheelBoardSettings(), [DriveReading("watchdog_s", 0.05, "s")], FASTEST)
    assert found == ({"watchdog_s": 0.05}, ())


def test_wheel_board_that_reports_no_watchdog_is_looked_up() -> None:
    assert len(drive_limits(WheelBoardSettings(), [], FASTEST).lookups) == 1


def test_unread_limits_of_an_odrive_are_looked_up_by_their_names_in_its_tool() -> None:
    settings = OdriveSettings(firmware="0.5", axes={"left": odrive_wheel(0, 0), "right": odrive_wheel(1, 1)})
    lookups = drive_limits(settings, [], FASTEST).lookups
    assert lookups[0] == "left, firmware 0.5: odrv0.axis0.motor.config.current_lim (at least 10 A)"
    assert "right, firmware 0.5: odrv0.axis1.controller.config.vel_limit (at least 40 turns/s)" in lookups
    assert "left, firmware 0.5: odrv0.axis0.motor.config.torque_lim (at least 0.5 N m)" in lookups
    assert len(lookups) == 8
    assert not any("0.6" in line for line in lookups)


def test_limits_of_an_odrive_of_0_6_have_other_names() -> None:
    settings = OdriveSettings(firmware="0.6", axes={"left": odrive_wheel(0, 0), "right": odrive_wheel(1, 1)})
    lookups = drive_limits(settings, [], FASTEST).lookups
    assert "right, firmware 0.6: odrv0.axis0.config.motor.current_soft_max (at least 10 A)" in lookups
    assert "right, firmware 0.6: odrv0.axis0.config.torque_soft_max (at least 0.5 N m)" in lookups


def test_what_an_odrive_reported_is_a_figure_and_not_looked_up() -> None:
    settings = OdriveSettings(firmware="0.5", axes={"left": odrive_wheel(0, 0), "right": odrive_wheel(1, 1)})
    readings = [DriveReading("left_vel_limit_turns_s", 45.0), DriveReading("right_current_limit_a", 12.0, "A")]
    found = drive_limits(settings, readings, FASTEST)
    assert found.measured == {"left_vel_limit_turns_s": 45.0, "right_current_limit_a": 12.0}
    assert len(found.lookups) == 6
    assert not any(line.startswith("left") and "vel_limit" in line for line in found.lookups)


def test_currents_that_a_vesc_reported_are_figures_and_only_its_speed_is_looked_up() -> None:
    readings = [
        DriveReading(f"{side}_{name}_current_a", value, "A")
        for side in ("left", "right")
        for name, value in (("least", -55.5), ("most", 60.0))
    ]
    found = drive_limits(vesc(), readings, FASTEST)
    assert found.measured == {reading.name: reading.value for reading in readings}
    assert [line.partition(": ")[2] for line in found.lookups] == [
        "Motor Settings > General > RPM: Max ERPM (at least 42000)"
    ] * 2


def test_currents_that_a_vesc_does_not_report_are_looked_up_too() -> None:
    lookups = drive_limits(vesc(), [], FASTEST).lookups
    assert sum("Motor Current Max" in line and "at least 10 A" in line for line in lookups) == 2


def test_limits_of_a_moteus_are_looked_up_by_their_names_in_its_console() -> None:
    axes = {"left": MoteusAxisSettings(servo_id=3, max_torque=2.0, gear_ratio=4.0)}
    lookups = drive_limits(MoteusSettings(can=CanSettings(fd=True), axes=axes), [], FASTEST).lookups
    assert lookups == (
        "left (id 3): conf get servo.max_current_A (at least 0.5 N m / torque constant, 8.27 / motor.Kv)",
        "left (id 3): conf get servo.max_velocity (at least 40 turns/s)",
    )


def test_rated_torque_of_a_cia402_drive_is_a_figure_and_gives_what_its_largest_torque_must_be() -> None:
    left, right = (Cia402WheelSettings(node_id=n, counts_per_turn=4096, max_torque=1.5) for n in (1, 2))
    readings = [
        DriveReading("left_rated_torque_n_m", 1.0, "N m"),
        DriveReading("right_max_torque_n_m", 3.0, "N m"),
        DriveReading("right_max_speed_rpm", 599.0, "rpm"),
    ]
    found = drive_limits(Cia402Settings(axes={"left": left, "right": right}), readings, FASTEST)
    assert found.measured["left_rated_torque_n_m"] == 1.0
    assert "left (node 1): object 0x6072:00, max torque (at least 1500 per mille of 0x6076)" in found.lookups
    assert "right (node 2): object 0x6080:00, max motor speed (at least 600 rpm)" in found.lookups
    assert not any(line.startswith("right") and "0x6072" in line for line in found.lookups)


def test_another_family_names_what_a_person_has_to_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(_LOOKUPS, OdriveSettings)
    settings = OdriveSettings(firmware="0.5", axes={"left": odrive_wheel(0, 0), "right": odrive_wheel(1, 1)})
    (line,) = drive_limits(settings, [], FASTEST).lookups
    assert line.startswith("type in odrivetool: odrv0.axis0.controller.config.vel_limit")


@pytest.mark.parametrize(("robot", "verdict"), [("segway", "passed"), ("segway-odrive", "confirmed")])
def test_step_is_confirmed_where_something_had_to_be_looked_up(robot: str, verdict: str) -> None:
    shown: list[str] = []
    file = load_robot(robot)
    site = SimulatedSite(file, show=shown.append)
    with site.session() as session:
        session.wait_until_fit()
        found = limits(session, expected_of(file))
    assert found.verdict == verdict
    assert any("current_lim" in line for line in shown) == (verdict == "confirmed")
    assert ("watchdog_s" in found.measured) == (robot == "segway")


def test_limits_that_the_person_cannot_confirm_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    file = load_robot("segway-odrive")
    site = SimulatedSite(file)
    with site.session() as session:
        session.wait_until_fit()
        monkeypatch.setattr(site.person, "answer", lambda: Answer.CANNOT)
        with pytest.raises(StepRefusedError, match="look them up"):
            limits(session, expected_of(file))
