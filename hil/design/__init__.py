# SPDX-License-Identifier: MIT
"""Design of feedback: linear models, the gains that are best for them, and the margins that are left."""
