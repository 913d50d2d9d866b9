# SPDX-License-Identifier: MIT
"""A module in a process that does not outlive its parent: arguments PARENT MODULE [ARGUMENT ...].

Not even a parent that is killed, which can end nothing any more.
"""

import runpy
import sys

from segway_ecc.node.parent import end_with

if __name__ == "__main__":
    _, first, name, *rest = sys.argv
    end_with(int(first))
    sys.argv = [name, *rest]
    runpy.run_module(name, run_name="__main__", alter_sys=True)
