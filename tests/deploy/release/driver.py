# SPDX-License-Identifier: MIT
"""The robot's side as a program that kills itself when a step begins, or before its nth change of the disk."""

import os
import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3]))

from segway_ecc.deploy.release.agent.journal import Reporter
from segway_ecc.deploy.release.agent.main import serve


class Killing(Reporter):
    """Ends without a word, as when the power goes."""

    def step(self, name: str) -> None:
        if name == os.environ["KILL_AT"]:
            os.kill(os.getpid(), signal.SIGKILL)
        super().step(name)


CHANGES = ("os.rename", "os.remove", "os.symlink", "os.link", "os.mkdir", "os.rmdir", "subprocess.Popen")
made = 0


def count(event: str, _arguments: tuple[object, ...]) -> None:
    """An audit hook: Python reports what it is about to do."""
    global made  # noqa: PLW0603 - a hook has no other place to count in
    if event in CHANGES:
        made += 1
        if made == int(os.environ["KILL_AFTER"]):
            os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    sys.addaudithook(count)
    source = sys.stdin.buffer
    agent = source.read(int(source.readline()))
    sys.exit(serve(agent, source, Killing(sys.stdout.buffer)))
