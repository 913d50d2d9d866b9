# SPDX-License-Identifier: MIT
"""Hardware in the loop: simulated plants and devices, and kernels to run them in."""
