# SPDX-License-Identifier: MIT
"""How fast this machine runs the loop, beside what else could be run in its place; one module per measurement."""
