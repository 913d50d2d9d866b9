# SPDX-License-Identifier: MIT
"""The frames in C, for the firmware: `python -P -m segway_ecc.firmware_io.drives.wheel_board.codec FOLDER`.

cantools makes the packing from wheel_board.dbc; counter and CRC, which it does not know, are our own files beside it.
"""

import argparse
import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

_GENERATED: Final = ("wheel_board.h", "wheel_board.c")
_OURS: Final = ("wheel_board_protection.h", "wheel_board_protection.c")
_MODULE: Final = "segway_ecc.firmware_io.drives.wheel_board"


class CodecError(Exception):
    """The C files could not be made; the text states why and what to do."""


def generate(folder: Path) -> list[Path]:
    """Write the C files into `folder`, which is made where it is not there, and return them.

    Raises:
        CodecError: cantools is not installed or failed, or the folder cannot be written.
    """
    if importlib.util.find_spec("cantools") is None:
        raise CodecError("cantools is not installed and makes the C code: pip install cantools")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in _OURS:
            with as_file(files(_MODULE) / name) as source:
                shutil.copyfile(source, folder / name)
        with as_file(files(_MODULE) / "wheel_board.dbc") as dbc:
            _run_cantools(dbc, folder)
    except OSError as error:
        raise CodecError(f"cannot write the C files to {folder}: {error.strerror}; name another folder") from error
    return [folder / name for name in (*_GENERATED, *_OURS)]


def _run_cantools(dbc: Path, folder: Path) -> None:
    """Let cantools generate; as a process, since the product does not import it."""
    options = ["--use-round", "--output-directory", str(folder), str(dbc)]
    done = subprocess.run(  # noqa: S603 - a program of this environment, and no shell reads the arguments
        [sys.executable, "-P", "-m", "cantools", "generate_c_source", *options],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        errors = done.stderr.strip().splitlines() or ["no error message"]
        raise CodecError(f"cantools generate_c_source failed on {dbc.name}: {errors[-1]}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Generate into the folder of the command line, print the files, and return the exit code."""
    parser = argparse.ArgumentParser(
        prog=f"python -P -m {_MODULE}.codec", description="Write the wheel board's C codec."
    )
    parser.add_argument("folder", type=Path, help="where to; made where it is not there")
    try:
        paths = generate(parser.parse_args(arguments).folder)
    except CodecError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.writelines(f"{path}\n" for path in paths)
    return 0


if __name__ == "__main__":
    sys.exit(main())
