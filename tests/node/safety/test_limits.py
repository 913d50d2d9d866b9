import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.safety.limits import limit, not_finite


@pytest.mark.parametrize(
    ("values", "index"),
    [
        ([], None),
        ([0.0, -1e308], None),
        ([1e308, 1e308, 1e308], None),
        ([1e308, 1e308, math.nan], 2),
        ([math.inf, -math.inf], 0),
        ([math.nan], 0),
        ([0.0, math.inf], 1),
        ([0.0, 1.0, -math.inf], 2),
        ([0.0, math.nan, math.inf], 1),
    ],
)
def test_the_first_value_that_is_not_finite_is_found(values: list[float], index: int | None) -> None:
    assert not_finite(values) == index


def test_each_command_has_its_own_limit() -> None:
    assert limit([5.0, -5.0, 5.0, -5.0, 0.0], [3.0, 3.0, 6.0, 6.0, 0.0]) == (3.0, -3.0, 5.0, -5.0, 0.0)


def test_a_limit_itself_is_still_allowed() -> None:
    assert limit([3.0, -3.0], [3.0, 3.0]) == (3.0, -3.0)


def test_a_command_without_a_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        limit([1.0, 2.0], [1.0])


@settings(derandomize=True)
@given(st.lists(st.tuples(st.floats(allow_nan=False), st.floats(0.0, 1e9))))
def test_nothing_passes_its_limit_and_nothing_within_it_is_changed(pairs: list[tuple[float, float]]) -> None:
    commands, bounds = [c for c, _ in pairs], [b for _, b in pairs]
    for (command, bound), limited in zip(pairs, limit(commands, bounds), strict=True):
        assert abs(limited) <= bound
        assert limited == command or (abs(command) > bound and math.copysign(limited, command) == limited)
