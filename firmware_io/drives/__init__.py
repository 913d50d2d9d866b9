# SPDX-License-Identifier: MIT
"""Drive families: each a folder with the same files."""
