# SPDX-License-Identifier: MIT
"""Setting an interface down: what the kernel is requested; with a real interface in tests/kernel/guest."""

import errno
import fcntl
import struct

import pytest

from segway_ecc.hil.drill.trial import interface_down, why_not_down

# From linux/sockios.h and linux/if.h; struct ifreq begins with the name, 16 bytes, then the flags.
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
OTHERS = 0x80C0


class Kernel:
    """Stands in for the kernel: one interface."""

    def __init__(self) -> None:
        self.flags = OTHERS | IFF_UP
        self.may = True

    def __call__(self, _socket: object, request: int, argument: bytes) -> bytes:
        name, flags = struct.unpack_from("16sH", argument)
        assert len(argument) == 40
        if name.rstrip(b"\0") != b"vcan7":
            raise OSError(errno.ENODEV, "No such device")
        if request == SIOCSIFFLAGS:
            if not self.may:
                raise OSError(errno.EPERM, "Operation not permitted")
            self.flags = flags
        else:
            assert request == SIOCGIFFLAGS
        return struct.pack("16sH22x", name, self.flags)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Kernel:
    found = Kernel()
    monkeypatch.setattr(fcntl, "ioctl", found)
    return found


def test_it_is_down_for_a_while_and_nothing_else_changes(kernel: Kernel) -> None:
    with interface_down("vcan7"):
        assert kernel.flags == OTHERS
    assert kernel.flags == OTHERS | IFF_UP


def test_it_is_up_again_after_an_error(kernel: Kernel) -> None:
    with pytest.raises(ZeroDivisionError), interface_down("vcan7"):
        raise ZeroDivisionError
    assert kernel.flags == OTHERS | IFF_UP


def test_the_reason_is_reported_and_asking_changes_nothing(kernel: Kernel) -> None:
    before = kernel.flags
    assert why_not_down("vcan7") is None
    assert why_not_down("vcan8") == "vcan8 cannot be set down: No such device"
    kernel.may = False
    assert why_not_down("vcan7") == "vcan7 cannot be set down: Operation not permitted"
    assert kernel.flags == before


def test_the_real_kernel_knows_no_such_interface() -> None:
    assert why_not_down("nosuch0") == "nosuch0 cannot be set down: No such device"
