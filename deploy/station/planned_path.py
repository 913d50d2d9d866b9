# SPDX-License-Identifier: MIT
"""Where a sequence leads, as a line on the floor. Pure."""

import math
from collections.abc import Sequence
from typing import Final

from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Segment

MOST_POINTS: Final = 64
"""Of a path: it is in every picture while the sequence plays."""
_CENTIMETRES: Final = 2


def planned_path(manoeuvre: Manoeuvre, start: Odometry) -> Sequence[tuple[float, float]]:
    """The line that a robot would drive that follows its set-points exactly, x and y, m, to the centimetre.

    The points are equally far apart in time, the first one where it starts and the last one where it ends.
    """
    duration_s = sum(segment.duration for segment in manoeuvre.segments)
    points = []
    x, y, heading, begin_s = start.x, start.y, start.heading, 0.0
    wanted = [duration_s * place / (MOST_POINTS - 1) for place in range(MOST_POINTS - 1)]
    for segment in manoeuvre.segments:
        end_s = begin_s + segment.duration
        while wanted and wanted[0] < end_s:
            points.append(_after(segment, (x, y, heading), wanted.pop(0) - begin_s)[:2])
        x, y, heading = _after(segment, (x, y, heading), segment.duration)
        begin_s = end_s
    return [(round(px, _CENTIMETRES), round(py, _CENTIMETRES)) for px, py in (*points, (x, y))]


def _after(segment: Segment, pose: tuple[float, float, float], passed_s: float) -> tuple[float, float, float]:
    """The pose after so long in a segment: an arc, whose chord lies in the direction of its middle."""
    x, y, heading = pose
    turned = segment.angular * passed_s
    way = segment.linear * passed_s
    chord = way if turned == 0.0 else way * math.sin(0.5 * turned) / (0.5 * turned)
    middle = heading + 0.5 * turned
    return x + chord * math.cos(middle), y + chord * math.sin(middle), heading + turned
