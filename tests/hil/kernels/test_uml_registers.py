# SPDX-License-Identifier: MIT
import subprocess
from pathlib import Path

import pytest

from segway_ecc.hil.kernels import uml
from segway_ecc.hil.kernels.guest import GuestError
from segway_ecc.hil.kernels.uml import register_variables


@pytest.fixture
def processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the kernel reports of the processor."""
    path = tmp_path / "cpuinfo"
    monkeypatch.setattr(uml, "_CPU", path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return path


def test_a_processor_with_small_registers_needs_nothing(processor: Path) -> None:
    processor.write_text("flags\t\t: fpu sse2 avx2 avx512f\n")
    assert register_variables() == {}


@pytest.mark.compiler
def test_a_processor_with_large_registers_gets_a_library_that_programs_run_with(processor: Path) -> None:
    processor.write_text("flags\t\t: fpu avx512f amx_bf16 amx_tile\n")
    variables = register_variables()
    assert Path(variables["LD_PRELOAD"]).is_file()
    subprocess.run(["/bin/true"], env=variables, check=True)


def test_a_missing_compiler_is_named_with_the_remedy(processor: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    processor.write_text("flags\t\t: amx_tile\n")
    monkeypatch.setenv("PATH", str(processor.parent))
    with pytest.raises(GuestError, match="sudo apt-get install gcc"):
        register_variables()
