"""Weighted least squares with free and penalised columns, and what it would be without a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LEAST = 1e-9
"""What a point that the fit passes through anyhow still says of its own error."""


@dataclass(frozen=True)
class Solution:
    """A fit of both coordinates at one stiffness.

    Attributes
    ----------
    free, penalised
        Coefficients of the columns, (columns, 2).
    left_out
        Residual of each point from the fit to all others, (points, 2).
    covariance
        Posterior covariance of all coefficients, free ones first, for noise of variance 1: it
        counts what noise does to them and, on average, what stiffness keeps them from (Wahba 1983).
    parameters
        Effective number of parameters of a coordinate.
    residual
        Residual of each point from the fit to all, (points, 2).
    """

    free: Floats
    penalised: Floats
    left_out: Floats
    covariance: Floats
    parameters: float
    residual: Floats


class Smoother:
    """Minimises sum of w |target - F a - P b|^2 + stiffness |b|^2.

    A linear smoother: without point i its residual is e_i / (1 - h_i), with h_i its leverage, so
    that no fit is repeated. One singular value decomposition, O(points columns^2), serves every
    stiffness.

    Parameters
    ----------
    free, penalised
        Columns F and P, (points, columns); P may have none.
    weights
        (points,), 0 for points that are told only how far off they are.
    """

    def __init__(self, free: Floats, penalised: Floats, weights: Floats) -> None:
        self._root = np.sqrt(weights)[:, np.newaxis]
        self._columns = free, penalised
        self._q, self._r = np.linalg.qr(self._root * free)
        bent = self._root * penalised
        self._cross = self._q.T @ bent
        self._u, self._s, self._vt = np.linalg.svd(bent - self._q @ self._cross, False)

    def solve(self, targets: Floats, stiffness: float) -> Solution:
        """Fit `targets`, (points, 2)."""
        weighted = self._root * targets
        square = self._s**2
        share = square / (square + stiffness) if len(square) else square
        inner = self._u.T @ weighted
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = np.where(self._s > 0, share / self._s, 0.0)
        penalised = self._vt.T @ (gain[:, np.newaxis] * inner)
        free = np.linalg.solve(self._r, self._q.T @ weighted - self._cross @ penalised)
        fitted = self._columns[0] @ free + self._columns[1] @ penalised
        residual = targets - fitted
        leverage = np.sum(self._q**2, axis=1) + self._u**2 @ share
        kept = np.maximum(1.0 - leverage, _LEAST)
        return Solution(
            free=free,
            penalised=penalised,
            left_out=residual / kept[:, np.newaxis],
            covariance=self._covariance(stiffness),
            parameters=float(leverage.sum()),
            residual=residual,
        )

    def _covariance(self, stiffness: float) -> Floats:
        """Invert the normal matrix by its parts."""
        of_bent = (self._vt.T / (self._s**2 + stiffness)) @ self._vt
        if of_bent.size:
            # Directions that no point tells of are held by the stiffness alone.
            of_bent += (np.eye(len(of_bent)) - self._vt.T @ self._vt) / stiffness
        back = np.linalg.inv(self._r)
        mixed = -back @ self._cross @ of_bent
        of_free = back @ back.T - mixed @ (back @ self._cross).T
        return np.block([[of_free, mixed], [mixed.T, of_bent]])
