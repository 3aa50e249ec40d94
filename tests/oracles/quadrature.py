"""Quadrature over the hemisphere with points ever closer about where a lobe lies: however sharp, at any incidence."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def about_mirror(elevation: float, width: float, points: int) -> tuple[Array, Array]:
    """Directions of y > 0 above the surface, shape (3, n), and twice their solid angles: for what is even in y.

    By elevation and azimuth, closest about the mirror direction of a `wi` in the x-z plane, the horizon and that plane.

    Parameters
    ----------
    elevation : float
        Of `wi`, whose x is positive [rad].
    width : float
        Scale of the lobe [rad].
    points : int
        Of the rule in each panel, in each coordinate.
    """
    high = np.concatenate([graded(elevation, width / 4, np.pi / 2), graded(0, min(elevation, 1) / 4, np.pi / 2)])
    least = width * min(1.0, np.sin(elevation) + width) / 4  # a lobe of half vectors is drawn out by grazing incidence
    turned = np.concatenate([graded(0, least, np.pi), graded(np.pi, least, np.pi)])
    (e, by_e), (turn, by_turn) = rule(high, np.pi / 2, points), rule(turned, np.pi, points)
    solid = 2 * np.outer(by_e * np.cos(e), by_turn).ravel()
    e, turn = (a.ravel() for a in np.meshgrid(e, turn, indexing="ij"))
    return np.stack([-np.cos(e) * np.cos(turn), np.cos(e) * np.sin(turn), np.sin(e)]), solid


def about_thread(angle: float, width: float, points: int) -> tuple[Array, Array]:
    """Directions above the surface, shape (3, n), and their solid angles, by the angles to the x axis and about it.

    Parameters
    ----------
    angle : float
        To the x axis, where a lobe lies that is even about it [rad].
    width : float
        Its scale [rad].
    points : int
        Of the rule in each panel, in each coordinate.
    """
    (a, by_a), (turn, by_turn) = (
        rule(places, np.pi, points) for places in (graded(angle, width / 4, np.pi), np.linspace(0, np.pi, 9))
    )
    solid = np.outer(by_a * np.sin(a), by_turn).ravel()
    a, turn = (x.ravel() for x in np.meshgrid(a, turn, indexing="ij"))
    return np.stack([np.cos(a), np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn)]), solid


def graded(at: float, least: float, end: float) -> Array:
    """Places between 0 and `end`: `at`, and others at distances from it that double from `least` on."""
    apart = least * 2.0 ** np.arange(1 + max(np.ceil(np.log2(end / least)), 1))
    places = np.concatenate([at - apart, [at], at + apart])
    return places[(places > 0) & (places < end)]


def rule(places: Array, end: float, points: int) -> tuple[Array, Array]:
    """Points and weights of the integral from 0 to `end`: Gauss and Legendre's rule between neighbouring places."""
    edges = np.unique(np.concatenate([[0.0], places, [end]]))
    x, w = np.polynomial.legendre.leggauss(points)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:, None] + edges[:-1, None]) / 2
    return (middle + half * x).ravel(), (half * w).ravel()
