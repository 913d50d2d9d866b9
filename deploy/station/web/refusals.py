"""What was refused, counted by cause."""

import enum
from collections import Counter
from collections.abc import Mapping


@enum.unique
class Cause(enum.StrEnum):
    """Why something was refused."""

    FOREIGN_HOST = "foreign host"
    """The page's address is a name that is not ours, as when somebody's name server points at us (DNS rebinding)."""
    FOREIGN_ORIGIN = "foreign origin"
    NO_SESSION = "no session"
    WRONG_TOKEN = "wrong token"  # noqa: S105 - the name of a cause
    VIEWER = "viewer"
    NOT_FOUND = "not found"
    BAD_HTTP = "bad HTTP"
    BAD_REQUEST = "bad request"
    OVERSIZED = "oversized"
    MALFORMED = "malformed"
    OUT_OF_RANGE = "out of range"
    REPLAYED_SOCKET = "replayed socket"
    REPLAYED_COMMAND = "replayed command"
    LOGIN_RATE = "login rate"
    CONNECTION_RATE = "connection rate"
    REQUEST_RATE = "request rate"
    MESSAGE_RATE = "message rate"
    COMMAND_RATE = "command rate"
    DRIVE_RATE = "drive rate"
    TOO_MANY_CONNECTIONS = "too many connections"
    TOO_MANY_SOCKETS = "too many sockets"
    SILENT_CONNECTION = "silent connection"
    TOO_SLOW = "too slow"
    FAILED = "failed"
    """A defect of ours, told once in the station's messages."""


class Refusals:
    """Counts; used by one thread."""

    def __init__(self) -> None:
        """Begin with nothing refused."""
        self._counts: Counter[Cause] = Counter()

    def add(self, cause: Cause) -> None:
        """Count one."""
        self._counts[cause] += 1

    def of(self, cause: Cause) -> int:
        """How many for this cause."""
        return self._counts[cause]

    def counts(self) -> Mapping[str, int]:
        """Every cause, most frequent first; those that never were are left out."""
        return {cause.value: count for cause, count in self._counts.most_common()}
