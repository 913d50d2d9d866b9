# SPDX-License-Identifier: MIT
"""Decodes what a browser sends: nothing of it is trusted. Pure."""

import math
from typing import Final

import msgspec

from segway_ecc.deploy.station.views import Command, Drive
from segway_ecc.deploy.station.web.refusals import Cause

MOST_BYTES: Final = 160 * 1024
"""Of a whole message: a sequence in JSON, where each line break takes two."""
MOST_SEQUENCE_BYTES: Final = 64 * 1024
_LONGEST_NAME: Final = 80
_LONGEST_ROBOT: Final = 256
_LARGEST_ID: Final = 2**53 - 1
"""A browser's numbers are exact up to here (ECMA-262, Number.MAX_SAFE_INTEGER)."""

_decoder: Final[msgspec.json.Decoder[Command | Drive]] = msgspec.json.Decoder(Command | Drive)


class RefusedMessageError(Exception):
    """A message that is refused, with the cause and the reason."""

    def __init__(self, cause: Cause, text: str, number: int = 0) -> None:
        """Refuse a message; `number` is its id where it has one."""
        super().__init__(text)
        self.cause = cause
        self.number = number


def decode(message: str, max_linear: float, max_angular: float) -> Command | Drive:
    """A command or a set-point within the limits, m/s and rad/s.

    Raises:
        RefusedError: It is anything else.
    """
    try:
        content = message.encode()
        if len(content) > MOST_BYTES:
            raise RefusedMessageError(Cause.OVERSIZED, f"a message has at most {MOST_BYTES} bytes")
        decoded = _decoder.decode(content)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise RefusedMessageError(Cause.MALFORMED, f"not a message: {str(error)[:200]}") from None
    if not 0 < decoded.id <= _LARGEST_ID:
        raise RefusedMessageError(Cause.OUT_OF_RANGE, "an id counts up from 1")
    _check_text("a robot's namespace", decoded.robot, _LONGEST_ROBOT, decoded.id)
    if isinstance(decoded, Command):
        _check_text("a name", decoded.name, _LONGEST_NAME, decoded.id)
        if len(decoded.text.encode("utf-8", "surrogatepass")) > MOST_SEQUENCE_BYTES:
            text = f"a sequence has at most {MOST_SEQUENCE_BYTES} bytes"
            raise RefusedMessageError(Cause.OVERSIZED, text, decoded.id)
        return decoded
    for name, value, limit in (("linear", decoded.linear, max_linear), ("angular", decoded.angular, max_angular)):
        if not (math.isfinite(value) and abs(value) <= limit):
            raise RefusedMessageError(Cause.OUT_OF_RANGE, f"{name} is at most {limit:g} either way", decoded.id)
    return decoded


def _check_text(what: str, text: str, longest: int, number: int) -> None:
    if len(text) > longest or not text.isprintable():
        why = f"{what} has at most {longest} letters, all of them printable"
        raise RefusedMessageError(Cause.OUT_OF_RANGE, why, number)
