# SPDX-License-Identifier: MIT
"""What is found by entry point: ours and others' alike, and what is broken is named and ends no other."""

import importlib
import importlib.metadata
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.firmware_io.drives.family import drive_family
from segway_ecc.firmware_io.errors import PluginError
from segway_ecc.firmware_io.imus.family import imu_family
from segway_ecc.firmware_io.plugins import DRIVES, IMUS, all_entry_points, entry_points
from segway_ecc.hil.devices.family import SIMULATED_DRIVES, SIMULATED_IMUS, simulated_drives, simulated_imu
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.cli.main import find_verbs
from segway_ecc.node.cli.verb import ENTRY_POINTS
from segway_ecc.node.config import decode_robot, load_robot
from segway_ecc.node.errors import ConfigurationError

ROOT = Path(__file__).parents[2]
FAMILIES = sorted(path.parent.name for path in (ROOT / "firmware_io" / "drives").glob("*/family.py"))
BASE = "name: r\nmodel: {source: m}\nwiring: {}\n"


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """A folder of distributions beside what is installed; lookups are made anew before and after."""
    monkeypatch.syspath_prepend(tmp_path)
    all_entry_points.cache_clear()
    yield tmp_path
    all_entry_points.cache_clear()
    for name in ("other_drive", "broken_drive"):
        sys.modules.pop(name, None)


def install(folder: Path, distribution: str, group: str, **points: str) -> None:
    info = folder / f"{distribution}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    lines = "".join(f"{name} = {value}\n" for name, value in points.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{lines}")


@pytest.mark.parametrize("group", [DRIVES, SIMULATED_DRIVES])
def test_every_family_of_ours_is_registered_with_its_simulated_drives(group: str) -> None:
    assert sorted(point.name for point in entry_points(group)) == FAMILIES


@pytest.mark.parametrize("group", [IMUS, SIMULATED_IMUS])
def test_every_imu_of_ours_is_registered_with_its_simulated_one(group: str) -> None:
    assert sorted(point.name for point in entry_points(group)) == ["icm42688_bridge", "xsens_mti"]


def test_an_unknown_drive_family_is_refused_in_a_line_that_lists_what_is_installed() -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode_robot(BASE + "hardware: {type: sail}", "r.yaml")
    assert (
        str(caught.value) == "r.yaml: there is no drive family 'sail'; installed are "
        "cia402, hoverboard, moteus, odrive, vesc, wheel_board"
    )


def test_a_type_that_is_no_text_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"there is no drive family \[1\]; installed are cia402"):
        decode_robot(BASE + "hardware: {type: [1]}", "r.yaml")


def test_an_unknown_imu_is_refused_in_a_line_that_lists_what_is_installed() -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode_robot(BASE + "hardware: {type: odrive, external_imu: {type: nose}}", "r.yaml")
    assert str(caught.value) == "r.yaml: there is no IMU 'nose'; installed are icm42688_bridge, xsens_mti"


def test_an_imu_may_be_named_or_left_to_the_default() -> None:
    files = [
        decode_robot(BASE + f"hardware: {{type: wheel_board, external_imu: {text}}}", "r.yaml")
        for text in ("{}", "{type: xsens_mti}")
    ]
    assert files[0] == files[1]


def test_a_family_of_another_distribution_is_found(installed: Path) -> None:
    (installed / "other_drive.py").write_text(
        "from segway_ecc.firmware_io.drives.vesc.family import FAMILY as vesc\n"
        "from dataclasses import replace\n"
        "from segway_ecc.firmware_io.drives.vesc.settings import VescSettings\n"
        "class Other(VescSettings, frozen=True, kw_only=True, tag='other'):\n    pass\n"
        "FAMILY = replace(vesc, settings=Other)\n"
    )
    install(installed, "other-drive", DRIVES, other="other_drive:FAMILY")
    wheel = "pole_pairs: 7, torque_constant: 0.1, max_torque: 1.0"
    text = (
        f"hardware: {{type: other, timeout_set_s: 0.03, axes: {{left: {{controller_id: 1, {wheel}}}, "
        f"right: {{controller_id: 2, {wheel}}}}}}}"
    )

    hardware = hardware_of(decode_robot(BASE + text, "r.yaml"))

    assert type(hardware).__name__ == "Other"
    assert drive_family("other").watchdog(hardware).timeout_s == 0.03
    with pytest.raises(PluginError, match=r"^there is no simulated drive family 'other'; installed are cia402, "):
        simulated_drives(hardware)


def test_a_family_that_cannot_be_imported_is_named_and_ends_no_other(installed: Path) -> None:
    (installed / "broken_drive.py").write_text("1 / 0\n")
    install(installed, "broken-drive", DRIVES, broken="broken_drive:FAMILY")

    with pytest.raises(ConfigurationError) as caught:
        decode_robot(BASE + "hardware: {type: broken}", "r.yaml")

    reason = "drive family 'broken' (broken_drive:FAMILY) cannot be imported: ZeroDivisionError: division by zero"
    assert str(caught.value) == f"r.yaml: {reason}"
    assert load_robot("cart-vesc").name == "cart-vesc"


@pytest.mark.parametrize("value", ["other_drive:NOTHING", "other_drive:VESC"])
def test_an_entry_point_that_names_no_family_or_one_of_another_name_is_refused(installed: Path, value: str) -> None:
    (installed / "other_drive.py").write_text(
        "from segway_ecc.firmware_io.drives.vesc.family import FAMILY as VESC\nNOTHING = None\n"
    )
    install(installed, "other-drive", DRIVES, other=value)
    with pytest.raises(PluginError, match=r"^drive family 'other' is none: its entry point must name a DriveFamily"):
        drive_family("other")


def test_an_imu_that_is_none_is_refused(installed: Path) -> None:
    install(installed, "other-imu", IMUS, other="os:name")
    with pytest.raises(PluginError, match=r"^IMU 'other' is none: its entry point must name an ImuFamily"):
        imu_family("other")


def test_two_families_of_one_name_are_refused(installed: Path) -> None:
    install(installed, "other-drive", DRIVES, odrive="other_drive:FAMILY")
    with pytest.raises(PluginError, match=r"^drive family 'odrive' is installed twice, as other_drive:FAMILY and segw"):
        drive_family("odrive")


def test_a_simulated_device_that_is_none_is_refused(installed: Path) -> None:
    (installed / "other_drive.py").write_text(
        "from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings\n"
        "class Other(XsensMtiSettings, frozen=True, kw_only=True, tag='other'):\n    pass\n"
    )
    install(installed, "other-imu", SIMULATED_IMUS, other="os:name")
    with pytest.raises(PluginError, match=r"^simulated IMU 'other' is none: its entry point must name a SimulatedImu$"):
        simulated_imu(importlib.import_module("other_drive").Other())


def test_verbs_that_cannot_be_imported_are_named_and_end_no_others(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours = set(find_verbs())
    (installed / "broken_drive.py").write_text("1 / 0\n")
    install(installed, "broken-verbs", ENTRY_POINTS, broken="broken_drive:VERBS")
    all_entry_points.cache_clear()

    assert set(find_verbs()) == ours
    reason = "'broken' (broken_drive:VERBS) cannot be imported: ZeroDivisionError: division by zero"
    assert capsys.readouterr().err == f"segway-ecc: the package of verbs {reason}\n"


@pytest.mark.parametrize(
    "robot", ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402", "cart-hoverboard", "cart-moteus"]
)
def test_a_robot_is_read_without_the_families_that_it_does_not_have(robot: str) -> None:
    family = {"cart-can": "wheel_board"}.get(robot, robot.removeprefix("cart-"))
    code = (
        "import sys; from segway_ecc.node.config import load_robot; load_robot(sys.argv[1]); "
        "print(*sorted({name.split('.')[3] for name in sys.modules "
        "if name.startswith('segway_ecc.firmware_io.drives.') and name.count('.') > 3}))"
    )
    found = subprocess.run([sys.executable, "-P", "-c", code, robot], check=True, capture_output=True, text=True)
    assert found.stdout.split() == [family]


def test_entry_points_are_those_that_are_installed() -> None:
    names = {point.name for point in importlib.metadata.entry_points(group=DRIVES)}
    assert {point.name for point in entry_points(DRIVES)} == names
