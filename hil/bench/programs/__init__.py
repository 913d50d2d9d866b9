# SPDX-License-Identifier: MIT
"""The programs that the loop is compared with, each of which can be read and run by itself."""
