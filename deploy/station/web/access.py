# SPDX-License-Identifier: MIT
"""The tokens: made once, shown once, and kept as salted hashes.

A token is 160 random bits, so a plain SHA-256 of it cannot be searched through; a slow hash, as the passwords of people
need it, would only let a stranger load the station.
"""

import enum
import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.node.errors import ConfigurationError

_TOKEN_BYTES: Final = 20
_SALT_BYTES: Final = 16
_LONGEST_TOKEN: Final = 200


@enum.unique
class Role(enum.StrEnum):
    """What somebody may do: a viewer watches, an operator commands."""

    VIEWER = "viewer"
    OPERATOR = "operator"


class _Stored(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file.

    Attributes:
        salt: In hexadecimal digits.
        hashes: By role, in hexadecimal digits.
    """

    salt: str
    hashes: dict[Role, str]


class Access:
    """Finds the role of a token."""

    def __init__(self, salt: bytes, hashes: Mapping[Role, bytes]) -> None:
        """Use the salt and the hashes of the tokens."""
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
            replace_file(path, msgspec.json.encode(kept), 0o600)
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


def replace_file(path: Path, content: bytes, mode: int) -> None:
    """Replace a file, or make it: whole or not at all, with that mode whatever the umask is, and durably.

    Raises:
        OSError: It cannot be written.
    """
    new = path.with_name(f".{path.name}.{os.getpid()}")
    new.unlink(missing_ok=True)
    file = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    with os.fdopen(file, "wb") as stream:
        os.fchmod(stream.fileno(), mode)
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    new.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
