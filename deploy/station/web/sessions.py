# SPDX-License-Identifier: MIT
"""Who is logged in. Pure: time is given, and nothing outlives the process."""

import dataclasses
import hashlib
import secrets
from collections import OrderedDict
from typing import Final

from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.limits import Bucket, Limits

LONGEST_S: Final = 12 * 3600
IDLE_S: Final = 30 * 60
LONGEST_NAME: Final = 40
_S: Final = 1_000_000_000
_ABSENT_NS: Final = 10 * _S
"""Somebody whose browser was gone for this long, and who logs in again, gets their name back."""
_MOST: Final = 1000


@dataclasses.dataclass(slots=True, eq=False)
class Session:
    """One login.

    Attributes:
        who: The operator's name; no two sessions at the same time have the same.
        role: What they may do.
        born_ns: When they logged in, monotonic.
        seen_ns: When they were last active, monotonic.
        commands: Their budget of commands.
        stops: Their budget of stops.
        drives: Their budget of set-points.
        sockets: Open ones.
        is_over: Whether it ended; its sockets are then closed.
    """

    who: str
    role: Role
    born_ns: int
    seen_ns: int
    commands: Bucket
    stops: Bucket
    drives: Bucket
    sockets: int = 0
    is_over: bool = False


class Sessions:
    """The sessions, by the secret that a browser keeps; only its hash is held here."""

    def __init__(self, limits: Limits) -> None:
        """Begin with no session."""
        self._limits = limits
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()

    def __len__(self) -> int:
        return len(self._sessions)

    def begin(self, name: str, role: Role, now_ns: int) -> tuple[str, Session]:
        """A new session and its secret."""
        self.sweep(now_ns)
        who = self._unused(named(name, role.value), now_ns)
        limits = self._limits
        commands, stops, drives = (Bucket(rate, now_ns) for rate in (limits.commands, limits.stops, limits.drives))
        session = Session(who, role, now_ns, now_ns, commands, stops, drives)
        if len(self._sessions) >= _MOST:  # the oldest without a browser gives way, or the oldest of all
            without = (session for session in self._sessions.values() if session.sockets == 0)
            self.end(next(without, None) or next(iter(self._sessions.values())))
        secret = secrets.token_urlsafe(32)
        self._sessions[_key(secret)] = session
        return secret, session

    def find(self, secret: str, now_ns: int) -> Session | None:
        """The session of a secret; it counts as active now."""
        session = self._sessions.get(_key(secret))
        if session is None or _is_expired(session, now_ns):
            return None
        session.seen_ns = now_ns
        return session

    def end(self, session: Session) -> None:
        """End a session."""
        session.is_over = True
        self._sessions = OrderedDict((key, other) for key, other in self._sessions.items() if other is not session)

    def sweep(self, now_ns: int) -> None:
        """End what is too old; whoever has a socket open is there, and not idle."""
        for key, session in list(self._sessions.items()):
            if session.sockets:
                session.seen_ns = now_ns
            if _is_expired(session, now_ns):
                session.is_over = True
                del self._sessions[key]

    def _unused(self, name: str, now_ns: int) -> str:
        """The name, or with a number behind it where somebody who is there has it."""
        taken = {session.who: session for session in self._sessions.values()}
        who, number = name, 1
        while (holder := taken.get(who)) is not None:
            if holder.sockets == 0 and now_ns - holder.seen_ns > _ABSENT_NS:
                self.end(holder)
                break
            number += 1
            who = f"{name} {number}"
        return who


def named(name: str, default: str) -> str:
    """A name that somebody gave, fit to be shown and logged."""
    shown = "".join(letter for letter in name[: 4 * LONGEST_NAME] if letter.isprintable())
    return " ".join(shown.split())[:LONGEST_NAME].strip() or default


def _key(secret: str) -> bytes:
    """What is compared is a hash, so the time that it takes reveals nothing of the secret."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).digest()


def _is_expired(session: Session, now_ns: int) -> bool:
    return now_ns - session.born_ns > LONGEST_S * _S or now_ns - session.seen_ns > IDLE_S * _S
