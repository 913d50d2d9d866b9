# SPDX-License-Identifier: MIT
"""Recursive least squares with forgetting, in the form of the normal equations, each with a prior of no deviation.

The prior is never forgotten: it bounds the covariance while nothing is to be learnt (no wind-up), as the forgetting
bounds the information. It shrinks an estimate by its share of all information. What is one of Kulhavy, "Restricted
exponential forgetting in real-time identification", Automatica 23 (1987), is simple here, where unknowns are few.
"""


class LineFit:
    """y = a x + b, with a prior for a alone: so much of x^2, summed over samples, weighs as much."""

    def __init__(self, kept: float, prior: float) -> None:
        """Keep this share of what was learnt from one sample to the next, 0 to 1."""
        self._kept, self._prior = kept, prior
        self._n = self._x = self._y = self._xx = self._xy = 0.0

    def add(self, x: float, y: float) -> None:
        """Take a sample."""
        kept = self._kept
        self._n = kept * self._n + 1.0
        self._x = kept * self._x + x
        self._y = kept * self._y + y
        self._xx = kept * self._xx + x * x
        self._xy = kept * self._xy + x * y

    def solve(self) -> float:
        """The slope a."""
        n = max(1.0, self._n)
        return (self._xy - self._x * self._y / n) / (self._xx - self._x * self._x / n + self._prior)

    @property
    def is_known(self) -> bool:
        """Whether the samples weigh more than twice as much as the prior: it takes less than a third off the slope."""
        n = max(self._n, 1.0)
        return self._xx - self._x * self._x / n > 2.0 * self._prior


class PlaneFit:
    """y = a x + b + c z, with priors for each: so much of x^2, 1 and z^2, summed over samples, weighs as much."""

    def __init__(self, kept: float, priors: tuple[float, float, float]) -> None:
        """Keep this share of what was learnt from one sample to the next, 0 to 1."""
        self._kept = kept
        self._x_prior, self._one_prior, self._z_prior = priors
        self._xx = self._x = self._xz = self._n = self._z = self._zz = 0.0
        self._xy = self._y = self._zy = 0.0

    def add(self, x: float, z: float, y: float) -> None:
        """Take a sample."""
        kept = self._kept
        self._xx = kept * self._xx + x * x
        self._x = kept * self._x + x
        self._xz = kept * self._xz + x * z
        self._n = kept * self._n + 1.0
        self._z = kept * self._z + z
        self._zz = kept * self._zz + z * z
        self._xy = kept * self._xy + x * y
        self._y = kept * self._y + y
        self._zy = kept * self._zy + z * y

    def solve(self) -> tuple[float, float, float]:
        """The unknowns a, b and c, by Cramer's rule; the determinant is not zero, since the priors are in it."""
        a, b, c = self._xx + self._x_prior, self._x, self._xz
        d, e, f = self._n + self._one_prior, self._z, self._zz + self._z_prior
        u, v, w = self._xy, self._y, self._zy
        df, bf, be = d * f - e * e, b * f - c * e, b * e - c * d
        determinant = a * df - b * bf + c * be
        x = (u * df - b * (v * f - e * w) + c * (v * e - d * w)) / determinant
        one = (a * (v * f - e * w) - u * bf + c * (b * w - c * v)) / determinant
        z = (a * (d * w - e * v) - b * (b * w - c * v) + u * be) / determinant
        return x, one, z
