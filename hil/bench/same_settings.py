# SPDX-License-Identifier: MIT
"""The user's loop, its thread set as our own loop's thread is: arguments WORD ..."""

from segway_ecc.hil.bench.programs import user_loop
from segway_ecc.node.cycle.real_time import real_time_loop

if __name__ == "__main__":
    user_loop.main(real_time_loop())
