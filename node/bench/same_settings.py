"""`python -m node.bench.same_settings WORD ...`: the user's loop, its thread set as our own loop's thread is."""

from node.bench.programs import user_loop
from node.cycle.real_time import real_time_loop

if __name__ == "__main__":
    user_loop.main(real_time_loop())
