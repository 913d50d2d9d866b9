# SPDX-License-Identifier: MIT
"""The tokens, made once, shown once and kept as salted hashes; and the sessions, none of which outlives the process.

A token is 160 random bits, so a plain SHA-256 of it cannot be searched through; a slow hash, as the passwords of people
need it, would only let a stranger load the station.
"""

import dataclasses
import enum
import hashlib
import hmac
import secrets
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.deploy.release.agent.files import write_whole
from segway_ecc.deploy.station.web.limits import Bucket, Limits
from segway_ecc.node.errors import ConfigurationError

_TOKEN_BYTES: Final = 20
_SALT_BYTES: Final = 16
_LONGEST_TOKEN: Final = 200
LONGEST_S: Final = 12 * 3600
IDLE_S: Final = 30 * 60
_LONGEST_NAME: Final = 40
_S: Final = 1_000_000_000
_ABSENT_NS: Final = 10 * _S
"""Somebody whose browser was gone for this long, and who logs in again, gets their name back."""
_MOST_SESSIONS: Final = 1000


@enum.unique
class Role(enum.StrEnum):
    """What somebody may do: a viewer watches, an operator commands."""

    VIEWER = "viewer"
    OPERATOR = "operator"


class _Stored(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file; both in hexadecimal digits."""

    salt: str
    hashes: dict[Role, str]


class Access:
    """Finds the role of a token."""

    def __init__(self, salt: bytes, hashes: Mapping[Role, bytes]) -> None:
        self._salt = salt
        self._hashes = dict(hashes)

    def role(self, token: str) -> Role | None:
        """Whose token this is, or None; takes the same time whichever it is."""
        if len(token) > _LONGEST_TOKEN:
            return None
        digest = _digest(self._salt, token)
        found = None
        for role, expected in self._hashes.items():
            if hmac.compare_digest(digest, expected):
                found = role
        return found

    def save(self, path: Path) -> None:
        """Keep the hashes in a file that only its owner reads; it is there whole or not at all.

        Raises:
            ConfigurationError: It cannot be written.
        """
        kept = _Stored(self._salt.hex(), {role: digest.hex() for role, digest in self._hashes.items()})
        try:
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_whole(path, msgspec.json.encode(kept), 0o600)
        except OSError as error:
            raise ConfigurationError(f"the tokens cannot be kept in {path}: {error.strerror}; see --folder") from None


def new_access() -> tuple[Access, Mapping[Role, str]]:
    """New tokens, by role, and the access that accepts them."""
    salt = secrets.token_bytes(_SALT_BYTES)
    tokens = {role: secrets.token_urlsafe(_TOKEN_BYTES) for role in (Role.OPERATOR, Role.VIEWER)}
    return Access(salt, {role: _digest(salt, token) for role, token in tokens.items()}), tokens


def load_access(path: Path) -> Access | None:
    """What a station kept, or None where it kept nothing; a file that others could read is closed to them.

    Raises:
        ConfigurationError: The file cannot be read, or is none of ours.
    """
    try:
        content = path.read_bytes()
        path.chmod(0o600)
        kept = msgspec.json.decode(content, type=_Stored)
        hashes = {role: bytes.fromhex(kept.hashes[role]) for role in Role}
        return Access(bytes.fromhex(kept.salt), hashes)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError, KeyError):
        raise ConfigurationError(
            f"{path} does not hold the hashes of two tokens; make new ones: --new-tokens"
        ) from None


def _digest(salt: bytes, token: str) -> bytes:
    return hashlib.sha256(salt + token.encode("utf-8", "surrogatepass")).digest()


@dataclasses.dataclass(slots=True, eq=False)
class Session:
    """One login.

    Attributes:
        who: The operator's name; no two sessions at the same time have the same.
        born_ns: When they logged in, monotonic.
        seen_ns: When they were last active, monotonic.
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
        if len(self._sessions) >= _MOST_SESSIONS:  # the oldest without a browser gives way, or the oldest of all
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
    shown = "".join(letter for letter in name[: 4 * _LONGEST_NAME] if letter.isprintable())
    return " ".join(shown.split())[:_LONGEST_NAME].strip() or default


def _key(secret: str) -> bytes:
    """What is compared is a hash, so the time that it takes reveals nothing of the secret."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).digest()


def _is_expired(session: Session, now_ns: int) -> bool:
    return now_ns - session.born_ns > LONGEST_S * _S or now_ns - session.seen_ns > IDLE_S * _S
