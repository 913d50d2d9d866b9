"""A service does not lock memory where there is a limit; that it does without one is seen in the image's boot test."""

import subprocess
import sys

SCRIPT = """
import resource, sys
from node.service_memory import lock_memory
hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
resource.setrlimit(resource.RLIMIT_MEMLOCK, ({limit}, hard))
print(lock_memory())
held = bytearray(8 << 20)
held[::4096] = b"x" * (len(held) // 4096)
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
print(locked.split()[1])
"""


def answers(limit: str) -> tuple[str, int]:
    done = subprocess.run(
        [sys.executable, "-I", "-c", SCRIPT.format(limit=limit)], capture_output=True, text=True, check=True
    )
    said, kilobytes = done.stdout.split()
    return said, int(kilobytes)


def test_with_a_limit_nothing_is_locked() -> None:
    assert answers("1 << 16") == ("False", 0)
