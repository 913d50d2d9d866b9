# SPDX-License-Identifier: MIT
import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.deploy.station.views import Act, Command, Drive, Seen
from segway_ecc.deploy.station.web.browser import RefusedMessageError, decode
from segway_ecc.deploy.station.web.shared import Cause
from tests.fuzzing import fuzzed

MAX = (1.0, 2.0)
COMMAND = {"kind": "command", "id": 1, "robot": "/alice", "act": "arm"}
SEEN = {"kind": "seen", "time_s": 12.5}
DRIVE = {"kind": "drive", "id": 1, "robot": "/alice", "linear": 0.5, "angular": -1.0}


def refusal(message: str) -> Cause:
    with pytest.raises(RefusedMessageError) as refused:
        decode(message, *MAX)
    return refused.value.cause


def test_a_command_a_set_point_and_a_picture_that_was_seen() -> None:
    text = json.dumps({**COMMAND, "act": "play", "text": "a\nb", "name": "x"})
    assert decode(text, *MAX) == Command(id=1, robot="/alice", act=Act.PLAY, text="a\nb", name="x")
    assert decode(json.dumps(DRIVE), *MAX) == Drive(id=1, robot="/alice", linear=0.5, angular=-1.0)
    assert decode(json.dumps(DRIVE | {"linear": -1.0, "angular": 2}), *MAX) is not None
    assert decode(json.dumps(SEEN), *MAX) == Seen(time_s=12.5)


@pytest.mark.parametrize(
    ("message", "cause"),
    [
        ("", Cause.MALFORMED),
        ("null", Cause.MALFORMED),
        ("[]", Cause.MALFORMED),
        ("{}", Cause.MALFORMED),
        ('{"kind": "hello"}', Cause.MALFORMED),
        (json.dumps(COMMAND)[:-1], Cause.MALFORMED),
        (json.dumps(COMMAND) + "x", Cause.MALFORMED),
        (json.dumps(COMMAND | {"more": 1}), Cause.MALFORMED),
        (json.dumps(DRIVE | {"text": ""}), Cause.MALFORMED),
        (json.dumps(SEEN | {"id": 1}), Cause.MALFORMED),
        (json.dumps(SEEN | {"time_s": math.nan}), Cause.MALFORMED),
        (json.dumps(SEEN | {"time_s": "1"}), Cause.MALFORMED),
        (json.dumps(COMMAND | {"act": "format"}), Cause.MALFORMED),
        (json.dumps(COMMAND | {"id": "1"}), Cause.MALFORMED),
        (json.dumps(COMMAND | {"id": 1.5}), Cause.MALFORMED),
        (json.dumps(COMMAND | {"id": True}), Cause.MALFORMED),
        (json.dumps(COMMAND | {"robot": None}), Cause.MALFORMED),
        (json.dumps(DRIVE | {"linear": "0.5"}), Cause.MALFORMED),
        (json.dumps(DRIVE | {"linear": math.nan}), Cause.MALFORMED),
        (json.dumps(DRIVE | {"linear": math.inf}), Cause.MALFORMED),
        (json.dumps(DRIVE).replace("0.5", "1e999"), Cause.MALFORMED),
        ("[" * 60_000, Cause.MALFORMED),
        ('{"kind":"command","x":' + "[" * 60_000, Cause.MALFORMED),
        ('{"kind":"command","id":1,"robot":"\ud800","act":"arm"}', Cause.MALFORMED),
        (json.dumps(COMMAND | {"id": 0}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"id": -1}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"id": 2**53}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"robot": "/" * 257}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"robot": "/a\u202e"}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"name": "x" * 81}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"name": "a\nb"}), Cause.OUT_OF_RANGE),
        (json.dumps(DRIVE | {"linear": 1.001}), Cause.OUT_OF_RANGE),
        (json.dumps(DRIVE | {"linear": -1.001}), Cause.OUT_OF_RANGE),
        (json.dumps(DRIVE | {"angular": 2.001}), Cause.OUT_OF_RANGE),
        (json.dumps(DRIVE | {"angular": 1e308}), Cause.OUT_OF_RANGE),
        (json.dumps(COMMAND | {"text": "x" * 65_537}), Cause.OVERSIZED),
        (json.dumps(COMMAND | {"text": "\u20ac" * 22_000}, ensure_ascii=False), Cause.OVERSIZED),
        (json.dumps(COMMAND) + " " * 170_000, Cause.OVERSIZED),
    ],
)
def test_invalid_message_is_refused(message: str, cause: Cause) -> None:
    assert refusal(message) is cause


def test_a_sequence_of_64_kib_is_taken_with_its_line_breaks() -> None:
    assert isinstance(decode(json.dumps(COMMAND | {"act": "play", "text": "\n" * 65_536}), *MAX), Command)


JSON = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just([[{"a": [1]}]])
NUMBERS = st.floats() | st.integers() | st.sampled_from([0.5, -1.0, 1e308, 5e-324])
FIELDS = st.fixed_dictionaries(
    {},
    optional={
        "kind": st.sampled_from(["command", "drive", "seen", "hello"]) | JSON,
        "id": st.integers() | JSON,
        "robot": st.sampled_from(["/alice", "/" * 257]) | JSON,
        "act": st.sampled_from(list(Act)) | JSON,
        "text": JSON,
        "name": JSON,
        "linear": NUMBERS | JSON,
        "angular": NUMBERS | JSON,
        "time_s": NUMBERS | JSON,
        "extra": JSON,
    },
)


def _holds(message: str) -> None:
    """Decoding gives what the robots may be given, or its one error."""
    try:
        decoded = decode(message, *MAX)
    except RefusedMessageError:
        return
    if isinstance(decoded, Seen):
        assert math.isfinite(decoded.time_s)
        return
    assert 0 < decoded.id < 2**53
    assert len(decoded.robot) <= 256
    if isinstance(decoded, Drive):
        assert math.isfinite(decoded.linear)
        assert math.isfinite(decoded.angular)
        assert abs(decoded.linear) <= 1.0
        assert abs(decoded.angular) <= 2.0


@fuzzed
@given(FIELDS.map(json.dumps) | st.text(max_size=200) | JSON.map(json.dumps))
def test_fuzzed_message_is_valid_or_refused(message: str) -> None:
    _holds(message)


@fuzzed
@given(st.sampled_from([COMMAND, DRIVE, SEEN]), st.data())
def test_mutated_message_is_valid_or_refused(message: dict[str, Any], data: st.DataObject) -> None:
    text = json.dumps(message)
    at = data.draw(st.integers(0, len(text)))
    _holds(text[:at] + data.draw(st.text(max_size=5)) + text[at + data.draw(st.integers(0, 5)) :])
