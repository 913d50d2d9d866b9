# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict, bad, good, is_fit, warning


@pytest.mark.parametrize("verdict", [Verdict.WARNING, Verdict.BAD])
@pytest.mark.parametrize(("effect", "remedy"), [("", "do"), ("so", ""), ("", "")])
def test_finding_that_is_not_good_needs_effect_and_remedy(verdict: Verdict, effect: str, remedy: str) -> None:
    with pytest.raises(ValueError, match=r"finding 'disk' is .* and lacks"):
        Finding("disk", verdict, "full", effect, remedy)


def test_what_is_good_needs_neither() -> None:
    assert good("disk", "empty") == Finding("disk", Verdict.GOOD, "empty", "", "")


def test_only_what_is_bad_makes_a_machine_unfit() -> None:
    middling = [good("a", "x"), warning("b", "x", "so", "do")]
    assert is_fit(middling)
    assert not is_fit([*middling, bad("c", "x", "so", "do")])
