# SPDX-License-Identifier: MIT
"""Our own wheel board: two brushed motors with encoders behind one node on CAN, described in wheel_board.dbc."""
