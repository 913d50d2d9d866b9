# SPDX-License-Identifier: MIT
"""Whether a drive family keeps what the rest of the software relies on."""
