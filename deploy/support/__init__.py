# SPDX-License-Identifier: MIT
"""What helps to find out what went wrong: logs handed out, and all that a maintainer needs in one file."""
