# SPDX-License-Identifier: MIT
"""The command `segway-ecc`, which Ctrl-C ends without a traceback while it is still being imported."""

from segway_ecc.node.cli.interrupts import ends_at_once


def main() -> int:
    """Run one verb and return its exit code."""
    with ends_at_once():
        from segway_ecc.node.cli import main as command  # noqa: PLC0415 - it imports the rest
    return command.main()
