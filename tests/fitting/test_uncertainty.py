"""Pieces of the error bars against simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fitting.problem import Linear, Problem
from fitting.uncertainty import blocks_of, cut, deciding

SIZE = 64


def grid() -> Problem:
    """The residuals of a picture, all of whose pixels count."""
    p = Problem.__new__(Problem)
    p.pixel = np.arange(SIZE * SIZE)
    p.channel = p.view = np.zeros(SIZE * SIZE, dtype=int)
    p.widths = np.array([SIZE])
    return p


@pytest.mark.parametrize("blur", [0.0, 0.5, 0.8, 1.2])
def test_what_blocks_cut_of_correlated_noise(blur: float) -> None:
    """The variance of a sum, over 2000 pictures of noise, is what blocks see of it times the factor."""
    p = grid()
    block = blocks_of(p, 8)
    rng = np.random.default_rng(1)
    sums, seen, factors = [], [], []
    for _ in range(2000):
        noise = ndimage.gaussian_filter(rng.standard_normal((SIZE, SIZE)), blur, mode="wrap").ravel()
        sums.append(noise.sum())
        seen.append(np.sum(np.bincount(block, noise) ** 2))
        factors.append(cut(p, noise, block) if len(factors) < 50 else factors[0])
    missing = np.var(sums) / np.mean(seen)
    # The variance of 2000 sums is known to 1 / sqrt(1000); correlations from four pixels on are left out.
    assert np.mean(factors[:50]) == pytest.approx(missing, rel=0.13)
    assert (blur > 0.6) == (np.mean(factors[:50]) > 1.1)


def test_how_many_blocks_decide() -> None:
    """All alike where every pixel says the same; two where a highlight lies in two blocks, whatever the base does."""
    p = grid()
    block = blocks_of(p, 8)
    highlight = np.where((p.pixel // SIZE < 8) & (p.pixel % SIZE < 16), 1.0, 0.0) * np.where(p.pixel % 2, 1.0, -1.0)
    jacobian = np.stack([np.ones(SIZE * SIZE), highlight], axis=1)
    none = np.zeros(SIZE * SIZE)
    linear = Linear((none, none), (jacobian, jacobian))
    number = deciding(linear, np.ones(SIZE * SIZE), np.array([0, 1]), block)
    np.testing.assert_allclose(number, [(SIZE / 8) ** 2, 2], rtol=1e-9)
