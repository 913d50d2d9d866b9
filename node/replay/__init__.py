# SPDX-License-Identifier: MIT
"""A recorded run, through the same model and safety code again."""
