# SPDX-License-Identifier: MIT
"""The guard: disables the drives when commands stop, whatever became of the node."""
