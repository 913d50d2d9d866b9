# SPDX-License-Identifier: MIT
import lzma
from pathlib import Path

import pytest

from segway_ecc.hil.kernels.qemu import (
    FILE,
    FOLDER,
    PROGRAM,
    SYMBOLIC_LINK,
    ArchiveEntry,
    cpio_archive,
    module_content,
    modules_in_order,
)

DEP = """\
kernel/net/can/can.ko:
kernel/net/can/can-raw.ko: kernel/net/can/can.ko
kernel/drivers/net/can/dev/can-dev.ko.xz:
kernel/drivers/net/can/kvaser_pci.ko: kernel/drivers/net/can/sja1000.ko kernel/drivers/net/can/dev/can-dev.ko.xz
kernel/drivers/net/can/sja1000.ko: kernel/drivers/net/can/dev/can-dev.ko.xz
kernel/drivers/net/can/vcan.ko: kernel/drivers/net/can/dev/can-dev.ko.xz
"""


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    (tmp_path / "modules.dep").write_text(DEP)
    (tmp_path / "modules.builtin").write_text("kernel/drivers/virtio/virtio_pci.ko\nkernel/fs/ext4/ext4.ko\n")
    return tmp_path


def header(text: str) -> bytes:
    return text.replace(" ", "").encode()


def test_an_archive_is_newc() -> None:
    """By hand, from the kernel's buffer-format.rst: header of 110 bytes, name and content each padded to four."""
    devices = "00000000 00000000 00000000 00000000"

    packed = cpio_archive(
        [
            ArchiveEntry("bin", FOLDER),
            ArchiveEntry("init", PROGRAM, b"#!/x\n"),
            ArchiveEntry("a", FILE, b"1234"),
            ArchiveEntry("sh", SYMBOLIC_LINK, b"box"),
        ]
    )

    assert packed == b"".join(
        [
            header(
                f"070701 00000001 000041ED 00000000 00000000 00000001 00000000 00000000 {devices} 00000004 00000000"
            ),
            b"bin\0\0\0",
            header(
                f"070701 00000002 000081ED 00000000 00000000 00000001 00000000 00000005 {devices} 00000005 00000000"
            ),
            b"init\0\0#!/x\n\0\0\0",
            header(
                f"070701 00000003 000081A4 00000000 00000000 00000001 00000000 00000004 {devices} 00000002 00000000"
            ),
            b"a\x001234",
            header(
                f"070701 00000004 0000A1FF 00000000 00000000 00000001 00000000 00000003 {devices} 00000003 00000000"
            ),
            b"sh\0\0\0\0box\0",
            header(
                f"070701 00000005 00000000 00000000 00000000 00000001 00000000 00000000 {devices} 0000000B 00000000"
            ),
            b"TRAILER!!!\0\0\0\0",
        ]
    )


def test_modules_come_after_what_they_need_and_once(modules: Path) -> None:
    names = [path.name for path in modules_in_order(modules, ["kvaser_pci", "can-raw", "vcan"])]

    assert names == ["can-dev.ko.xz", "sja1000.ko", "kvaser_pci.ko", "can.ko", "can-raw.ko", "vcan.ko"]


def test_modules_are_found_below_the_kernels_folder(modules: Path) -> None:
    assert modules_in_order(modules, ["can"]) == [modules / "kernel/net/can/can.ko"]


def test_what_is_built_into_the_kernel_needs_no_module(modules: Path) -> None:
    assert modules_in_order(modules, ["virtio_pci", "can"]) == [modules / "kernel/net/can/can.ko"]


def test_a_module_that_is_not_there_is_named(modules: Path) -> None:
    with pytest.raises(ValueError, match=r"has no module isotp$"):
        modules_in_order(modules, ["can", "isotp"])


def test_compressed_modules_are_unpacked(tmp_path: Path) -> None:
    plain, packed = tmp_path / "a.ko", tmp_path / "b.ko.xz"
    plain.write_bytes(b"\x7fELF plain")
    packed.write_bytes(lzma.compress(b"\x7fELF packed"))

    assert module_content(plain) == b"\x7fELF plain"
    assert module_content(packed) == b"\x7fELF packed"
