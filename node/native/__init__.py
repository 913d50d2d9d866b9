# SPDX-License-Identifier: MIT
"""Models that arrive as generated C, generated C++ or FMUs: found out, compiled, loaded."""
