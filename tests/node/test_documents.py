# SPDX-License-Identifier: MIT
"""Documents as people write them."""

from pathlib import Path

import msgspec
import pytest

from segway_ecc.node.documents import decode_yaml, read_document, read_yaml
from segway_ecc.node.errors import ConfigurationError


class Length(msgspec.Struct):
    value: float


class Name(msgspec.Struct):
    value: str


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e-9", 1e-9), ("1e3", 1e3), ("-2E+2", -200.0), (".5e1", 5.0), ("1.e2", 100.0), ("1.5e3", 1500.0), ("+1e0", 1.0)],
)
def test_a_number_with_an_exponent_needs_no_point_and_no_sign(text: str, number: float) -> None:
    assert decode_yaml(f"value: {text}", Length, "it").value == number


@pytest.mark.parametrize("text", ["e3", "1e", "1e3x", "'1e3'", "x1e3"])
def test_what_only_looks_like_a_number_is_text(text: str) -> None:
    assert decode_yaml(f"value: {text}", Name, "it").value == text.strip("'")


LINE = 600
"""Characters of a message: one line of a log."""
LAUGHTER = "a0: &a0 [1, 1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 20))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[" * 100_000, "nested too deeply: at most 32 levels"),
        (LAUGHTER, r"an alias \(\*\) is not taken"),
        ("value: &a [*a]", r"an alias \(\*\) is not taken"),
        ("base: &b {value: 1}\nmore: {<<: *b}", r"an alias \(\*\) is not taken"),
        (f"value: 0x{'f' * 6000}", "a number has at most 64 characters"),
        (f"value: {'9' * 6000}", "a number has at most 64 characters"),
        (f"value: 1{':59' * 6000}", "a number has at most 64 characters"),
        (f"value: 1{':59' * 6000}.5", "a number has at most 64 characters"),
        ("value: 1:30", "1:30 is no plain number: write one such as 90 or 0x1f"),
        ("value: 1:30.5", "1:30.5 is no plain number"),
        ("value: 1_0", "1_0 is no plain number"),
        ("value: -017", "-017 is no plain number"),
        ("value: 2001-99-99", "month must be in"),
        ("value: !!int ''", r"a tag \(!\) is not taken"),
        ("value: !!bool maybe", r"a tag \(!\) is not taken"),
        ("value: !!timestamp never", r"a tag \(!\) is not taken"),
        ("!!python/object/apply:os.system ['true']", r"a tag \(!\) is not taken"),
        ('value: "\\ud800"', "surrogates not allowed"),
        ("[" + "1," * 20_000 + "]", "got `array`; found"),
        (f"value: '{'x' * 60_000}'", "got `str` at value; found 'x"),
        (f"{{ {'x' * 1000}: 1 }}", "missing required field"),
        (" " * (1 << 20) + "value: 1", "too long: at most 1048576 characters are read"),
    ],
)
def test_what_would_make_decoding_slow_or_large_is_refused_in_one_line(text: str, why: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^robot\.yaml.*{why}") as refused:
        decode_yaml(text, Length, "robot.yaml")
    assert len(str(refused.value)) < LINE
    assert "\n" not in str(refused.value)


def test_many_keys_are_compared_in_linear_time() -> None:
    text = "".join(f"k{number}: 1\n" for number in range(20_000))
    assert len(decode_yaml(text, dict[str, int], "it")) == 20_000


def test_key_that_stands_twice_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="the key 'value' stands twice"):
        decode_yaml("value: 1\nvalue: 2", Length, "it")


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/full"])
def test_a_file_without_end_is_refused(path: str) -> None:
    with pytest.raises(ConfigurationError, match="is too long: at most 1048576 characters are read"):
        read_yaml(read_document(Path(path)), path)


def test_a_nul_is_no_text() -> None:
    with pytest.raises(ConfigurationError, match="a NUL is no text"):
        read_yaml('value: "a\\0b"', "document")
