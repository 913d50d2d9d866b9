# SPDX-License-Identifier: MIT
"""Standard output and standard error of a command, which may be full, closed, or a pipe whose reader has gone."""

import io
import os
import sys
from typing import TYPE_CHECKING, Final, TextIO

from segway_ecc.node.errors import NodeError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_OUTPUT: Final = 1
_MESSAGES: Final = 2


class OutputError(NodeError):
    """Standard output takes nothing more."""


class _Output(io.FileIO):
    """What cannot be written is an error of ours; only a reader that has gone is not."""

    def write(self, data: "ReadableBuffer", /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise OutputError(f"cannot write to standard output: {error.strerror}") from error


class _Messages(io.FileIO):
    """A message that cannot be written is lost, and changes nothing else."""

    def write(self, data: "ReadableBuffer", /) -> int:
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


def claim_streams() -> None:
    """Keep standard output to what we print: what libraries and models write to it goes to standard error."""
    for descriptor in range(_MESSAGES + 1):
        try:
            os.fstat(descriptor)
        except OSError:  # closed: the next file that is opened must not be taken for it, and writing must fail
            os.dup2(os.open(os.devnull, os.O_RDONLY), descriptor)
    sys.stdout = _text(sys.stdout, _Output(os.dup(_OUTPUT), "w"))
    sys.stderr = _text(sys.stderr, _Messages(os.dup(_MESSAGES), "w"), line_buffering=True)
    os.dup2(_MESSAGES, _OUTPUT)


def flush_output() -> None:
    """Write what is still to be written, here and not when the interpreter ends; nothing is left for then.

    Raises:
        BrokenPipeError: Its reader has gone.
        OutputError: It cannot be written.
    """
    try:
        sys.stdout.flush()
    except (BrokenPipeError, OutputError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def _text(before: TextIO | None, file: io.FileIO, *, line_buffering: bool = False) -> TextIO:
    """Text into a file, encoded as before, what cannot be as an escape; None is a stream that was closed."""
    if not isinstance(before, io.TextIOWrapper):
        return io.TextIOWrapper(io.BufferedWriter(file), "utf-8", "backslashreplace", line_buffering=line_buffering)
    return io.TextIOWrapper(
        io.BufferedWriter(file),
        before.encoding,
        "backslashreplace",  # a text of a file or a model may hold what no encoding has
        line_buffering=before.line_buffering or line_buffering,
        write_through=before.write_through,
    )
