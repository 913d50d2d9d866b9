# SPDX-License-Identifier: MIT
"""The scenarios that ship with the package; `segway_ecc.hil.campaign.scenario` reads them."""
