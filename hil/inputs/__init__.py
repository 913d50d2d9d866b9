# SPDX-License-Identifier: MIT
"""What comes in from outside while a real robot runs: parameters, models, strangers on the bus, signals, operators."""
