# SPDX-License-Identifier: MIT
"""What a segway is made of, found from recorded runs."""
