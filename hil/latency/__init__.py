# SPDX-License-Identifier: MIT
"""How long a set-point takes from its publication to the first motor frame on the bus that is made from it."""
