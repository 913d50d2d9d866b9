# SPDX-License-Identifier: MIT
"""Long runs that must not grow: memory, open files and threads of every process, and the room of the log."""
