# SPDX-License-Identifier: MIT
"""What counts against a run of our own loop that came to its end."""

import pytest

from segway_ecc.hil.bench.contestants import _fault


@pytest.mark.parametrize(
    ("mode", "code", "fault"),
    [
        ("ARMED", 0, None),
        ("FAULT", 0, "10 deadlines in a row were missed"),
        ("ARMED", 9, "its log lacks records"),
        ("FAULT", 9, "10 deadlines in a row were missed"),
    ],
)
def test_a_loop_that_gave_up_or_whose_log_lacks_records_did_less(mode: str, code: int, fault: str | None) -> None:
    report = {
        "diagnostics": {
            "cart: timing": {"rate_hz": "5000"},
            "cart: mode": {"mode": mode, "reason": "10 deadlines in a row were missed"},
        }
    }
    assert _fault(report, code) == fault
