# SPDX-License-Identifier: MIT
"""The command `segway-ecc`, which Ctrl-C ends without a traceback while it is still being imported."""

from segway_ecc.node.cli.first import end_by_interrupt, run_imported


def main() -> int:
    """Run one verb and return its exit code."""
    is_ours = end_by_interrupt()
    from segway_ecc.node.cli import main as command  # noqa: PLC0415 - it imports the rest

    return run_imported(command.main, is_ours=is_ours)
