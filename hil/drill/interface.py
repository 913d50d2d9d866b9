# SPDX-License-Identifier: MIT
"""A network interface of this machine, set down and up again; see netdevice(7)."""

import contextlib
import fcntl
import os
import socket
import struct
from collections.abc import Iterator
from typing import Final

_SIOCGIFFLAGS: Final = 0x8913
_SIOCSIFFLAGS: Final = 0x8914
_IFF_UP: Final = 1
_REQUEST: Final = struct.Struct("16sh22x")
"""`struct ifreq` with the flags."""


@contextlib.contextmanager
def down(name: str) -> Iterator[None]:
    """Have an interface down, and up again when the context is left.

    Raises:
        OSError: There is none of that name, or we may not.
    """
    flags = _flags(name)
    _set_flags(name, flags & ~_IFF_UP)
    try:
        yield
    finally:
        _set_flags(name, flags | _IFF_UP)


def why_not_down(name: str) -> str | None:
    """Why an interface cannot be set down here; None where it can. Nothing is changed."""
    try:
        _set_flags(name, _flags(name))
    except OSError as error:
        return f"{name} cannot be set down: {os.strerror(error.errno or 0)}"
    return None


def _flags(name: str) -> int:
    return int(_REQUEST.unpack(_control(_SIOCGIFFLAGS, name, 0))[1])


def _set_flags(name: str, flags: int) -> None:
    _control(_SIOCSIFFLAGS, name, flags)


def _control(request: int, name: str, flags: int) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        return fcntl.ioctl(any_socket, request, _REQUEST.pack(os.fsencode(name)[:15], flags))
