# SPDX-License-Identifier: MIT
"""The case study of the thesis, run in every seat and compared."""
