# SPDX-License-Identifier: MIT
"""Which functions of libm are bit-identical on x86-64 with and without FMA, and on arm64: the table of the docs."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

SOURCE = Path(__file__).with_name("libm.c")
PAGE = Path(__file__).parents[2] / "docs" / "flight-recorder.md"
OPTIONS = ("-std=gnu11", "-O2", "-fno-builtin", "-ffp-contract=off", "-D_GNU_SOURCE")
WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"}
EMULATED = ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")
ROW = re.compile(r"^\| (`.+`) \| ([\d,]+)(?: to ([\d,]+))? \| ([\d,]+) \|$", re.MULTILINE)
MEASURED_WITH = "glibc 2.36"


def bits(program: Path, compiler: str, *before: str, without_fma: bool = False) -> dict[str, npt.NDArray[np.int64]]:
    """The values of each function, as whole numbers."""
    subprocess.run([compiler, *OPTIONS, str(SOURCE), "-o", str(program), "-lm"], check=True)
    environment = os.environ | (WITHOUT_FMA if without_fma else {})
    done = subprocess.run([*before, str(program)], check=True, capture_output=True, env=environment)
    names = done.stderr.decode().split()
    return dict(zip(names, np.frombuffer(done.stdout, np.int64).reshape(len(names), -1), strict=True))


@pytest.mark.proof
@pytest.mark.arm64
@pytest.mark.compiler
def test_the_docs_table_of_functions_that_differ(tmp_path: Path) -> None:
    if "fma" not in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split():
        pytest.skip("this processor has no FMA, which the table compares with")
    if os.confstr("CS_GNU_LIBC_VERSION") != MEASURED_WITH:
        pytest.skip(f"the table is that of {MEASURED_WITH}, and this is {os.confstr('CS_GNU_LIBC_VERSION')}")
    here = bits(tmp_path / "here", "gcc")
    plain = bits(tmp_path / "plain", "gcc", without_fma=True)
    arm64 = bits(tmp_path / "arm64", "aarch64-linux-gnu-gcc", *EMULATED)
    found = {name: (int(np.sum(here[name] != plain[name])), int(np.sum(here[name] != arm64[name]))) for name in here}
    listed = {
        name: (range(least, max(most, least) + 1), differing)
        for row, *texts in ROW.findall(PAGE.read_text(encoding="utf-8"))
        for least, most, differing in [[int(text.replace(",", "") or -1) for text in texts]]
        for name in re.findall(r"`(\w+)`", row)
    }
    assert listed.keys() == found.keys()
    assert {name: counts for name, counts in found.items() if counts[0] not in listed[name][0]} == {}
    assert {name: counts for name, counts in found.items() if counts[1] != listed[name][1]} == {}
