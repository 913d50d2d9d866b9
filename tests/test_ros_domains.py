# SPDX-License-Identifier: MIT
import subprocess
import sys

from tests import ros_domains

TAKE = """
import sys
from tests.ros_domains import next_domain
print(*(next_domain() for _ in range(6)), flush=True)
sys.stdin.read()
"""


def test_processes_side_by_side_have_domains_of_their_own_however_many_they_use() -> None:
    with subprocess.Popen([sys.executable, "-c", TAKE], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        theirs = set(other.stdout.readline().decode().split())
        ours = {ros_domains.next_domain() for _ in range(ros_domains.DOMAINS - len(theirs))}
        other.communicate()
    assert len(theirs) == 6
    assert not ours & theirs
    assert all(1 <= int(domain) <= ros_domains.DOMAINS for domain in ours | theirs)
