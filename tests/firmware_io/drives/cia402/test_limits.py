# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.drives.cia402.limits import Identity, interpolation_period, mode_names, mode_refusal

TORQUE_MODES = 0x208
"""Profile torque and cyclic synchronous torque."""


def test_identity_names_the_parts_that_a_drive_has() -> None:
    assert str(Identity(0x2E8, 0x10, 0x20001, 0x1234)) == (
        "vendor 0x000002E8, product 0x00000010, revision 0x00020001, serial 0x00001234"
    )
    assert str(Identity(0x2E8, None, None, None)) == "vendor 0x000002E8"
    assert str(Identity(None, None, None, None)) == "not reported (0x1018)"


def test_modes_are_named_by_their_bits_and_the_manufacturers_are_left_out() -> None:
    assert mode_names(TORQUE_MODES) == "profile torque (4), cyclic synchronous torque (10)"
    assert mode_names(0x10 | 0x10000) == "reserved (5)"
    assert mode_names(0x10000) == "none of the profile"


def test_nothing_is_against_a_drive_that_has_the_mode_or_does_not_report_its_modes() -> None:
    assert mode_refusal(TORQUE_MODES) is None
    assert mode_refusal(None) is None


def test_profile_torque_alone_is_refused_by_name() -> None:
    assert mode_refusal(0x08) == (
        "it does not take mode 10, cyclic synchronous torque: it lacks it; 0x6502 offers profile torque (4); "
        "profile torque alone is not enough, since the drive ramps each torque (0x6087)"
    )
    assert "profile torque" not in str(mode_refusal(0x80))


def test_refused_mode_is_named_with_what_the_drive_did_and_offers() -> None:
    assert mode_refusal(None, "stays in mode 3, as 0x6061 reads") == (
        "it does not take mode 10, cyclic synchronous torque: it stays in mode 3, as 0x6061 reads; "
        "it does not report its modes (0x6502)"
    )
    assert str(mode_refusal(TORQUE_MODES, "refuses it: no")).endswith(
        "it refuses it: no; 0x6502 offers profile torque (4), cyclic synchronous torque (10)"
    )


@pytest.mark.parametrize(
    ("cycle_us", "period"),
    [(10_000, (10, -3)), (5_000, (5, -3)), (2_500, (25, -4)), (1_250, (125, -5)), (3_333, (33, -4)), (125, (125, -6))],
)
def test_interpolation_period_is_that_of_sync(cycle_us: int, period: tuple[int, int]) -> None:
    assert interpolation_period(cycle_us) == period
    assert period[0] * 10.0 ** period[1] == pytest.approx(cycle_us * 1e-6, rel=0.01)
