# SPDX-License-Identifier: MIT
"""A whole simulated robot and its base station on this machine, to be seen, pushed and broken in the browser."""
