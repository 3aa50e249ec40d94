"""Of the sharpest lobes, at grazing incidence as well, samples in float64 are distributed as the density: chi-square.

Through Mitsuba, in float32, a half vector at grazing incidence cannot be had back from two directions: their rounding turns
it by that over the cosine. `tests.plugins.test_hard_sampling` goes as far as it can.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import pytest
from scipy import stats

from brdf import Model, builtin, defaults
from tests.brdf.arrays import VECTORS, Array, to_numpy
from tests.oracles import directions

#: Samples; cells along a side; points along a side of a cell, before and after one refinement.
SAMPLES, CELLS, POINTS = 1 << 19, 61, (4, 8)
#: A cell in which the refinement makes more than this many standard deviations is left out: the horizon runs through it.
UNRESOLVED = 0.3
#: With fewer expected, cells are thrown together.
FEW = 5
#: The level of each test, so that all pass with 99 % probability if all is right.
LEVEL = 0.01 / 20

B = builtin()


class Slopes(NamedTuple):
    """Directions by the slopes of the half vector, ``m p / (1 - p^2)`` each: a sharp lobe fills the square."""

    wi: Array
    m: tuple[float, float]

    def directions(self, p: Array) -> tuple[Array, Array]:
        """Directions of points of the square, shape (3, n) of (2, n), and solid angle by area."""
        scale = np.array(self.m)[:, None]
        x, y = scale * p / (1 - p * p)
        cos = 1 / np.sqrt(1 + x * x + y * y)
        h = np.stack([x, y, np.ones_like(x)]) * cos
        seen = self.wi @ h
        by = np.prod(scale * (1 + p * p) / (1 - p * p) ** 2, axis=0)
        return 2 * seen * h - self.wi[:, None], np.where(seen > 0, 4 * seen * cos**3 * by, 0)

    def points(self, wo: Array) -> Array:
        h = wo + self.wi[:, None]
        return inverse(h[:2] / h[2] / np.array(self.m)[:, None])


class Cone(NamedTuple):
    """Directions by the angle to an axis, 0 for x and 1 for y, ``width p / (1 - p^2)`` from that of the mirror direction,
    and by the angle about it."""

    wi: Array
    width: float
    axis: int

    def frame(self, w: Array) -> Array:
        return w[[0, 1, 2]] if self.axis == 0 else w[[1, 0, 2]]

    @property
    def middle(self) -> float:
        x, y, z = self.frame(self.wi)
        return float(np.arctan2(np.hypot(y, z), -x))

    def directions(self, p: Array) -> tuple[Array, Array]:
        x, y = p
        a, turn = self.middle + self.width * x / (1 - x * x), (1 + y) * (np.pi / 2)
        by = self.width * (1 + x * x) / (1 - x * x) ** 2 * (np.pi / 2)
        there = (a > 0) & (a < np.pi)
        w = self.frame(np.stack([np.cos(a), np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn)]))
        return w, np.where(there, np.abs(np.sin(a)) * by, 0)

    def points(self, wo: Array) -> Array:
        x, y, z = self.frame(wo)
        a, turn = np.arctan2(np.hypot(y, z), x), np.arctan2(z, y)
        return np.stack([inverse((a - self.middle) / self.width), turn / (np.pi / 2) - 1])


def inverse(s: Array) -> Array:
    """The `p` of which ``p / (1 - p^2)`` is `s`."""
    return 2 * s / (1 + np.sqrt(1 + 4 * s * s))


def p_value(model: Model, numbers: dict[str, Any], wi: Array, domain: Slopes | Cone) -> float:
    """Of the glossy lobe, seen from `wi`."""
    vector = VECTORS["float64"]
    given = vector(*wi.tolist())
    p = defaults(model, vector, **numbers)
    dr.make_opaque(given, vars(p))
    wo = to_numpy(model.sample(p, given, vector(*np.random.default_rng(7).random((3, SAMPLES))), 1))
    edges = np.linspace(-1, 1, CELLS + 1)
    found = np.histogram2d(*domain.points(wo[:, wo[2] > 0]), bins=(edges, edges))[0]
    tables = []
    for n in POINTS:
        middle = (np.arange(CELLS * n) + 0.5) * (2 / (CELLS * n)) - 1
        square: Array = np.array(np.meshgrid(middle, middle, indexing="ij"), dtype=np.float64).reshape(2, -1)
        w, area = domain.directions(square)
        up = (w[2] > 0) & (area > 0)
        density = to_numpy(model.pdf(p, given, vector(w[0], w[1], np.where(up, w[2], 1)))[1])
        table = np.where(up, density * area, 0).reshape(CELLS, n, CELLS, n).mean(axis=(1, 3))
        tables.append(SAMPLES * table * (2 / CELLS) ** 2)
    coarse, fine = tables
    good = np.abs(fine - coarse) <= UNRESOLVED * np.sqrt(np.maximum(fine, 1))
    assert fine[good].sum() > 0.5 * fine.sum() > 0.1 * SAMPLES
    many = good & (fine >= FEW)
    rest = good & ~many
    want, got = np.append(fine[many], fine[rest].sum()), np.append(found[many], found[rest].sum())
    want, got = want[want > 0], got[want > 0]
    return float(stats.chi2.sf(((got - want) ** 2 / want).sum(), len(want)))


M, N = 1e-4, 1e6
HALF = {
    "beckmann": (B["cooktorrance"](), {"m": M}, (M, M)),
    "ggx": (B["cooktorrance"](distribution="ggx"), {"m": M}, (M, M)),
    "ggx-smith": (B["cooktorrance"](distribution="ggx", masking="smith"), {"m": M}, (M, M)),
    "blinn": (B["cooktorrance"](distribution="blinn"), {"m": M}, (M, M)),
    "two": (B["cooktorrance"](roughness="anisotropic"), {"m_u": M, "m_v": 3 * M}, (M, 3 * M)),
    "ward": (B["ward"](), {"alpha_u": M, "alpha_v": 3 * M}, (M, 3 * M)),
    "blinnphong": (B["blinnphong"](), {"exponent": N}, (1e-3, 1e-3)),
}


@pytest.mark.parametrize("cos", [1e-2, 1e-5])
@pytest.mark.parametrize("name", HALF)
def test_half_vectors(name: str, cos: float) -> None:
    model, numbers, m = HALF[name]
    wi = directions.unit(cos, 0.4)
    assert p_value(model, numbers, wi, Slopes(wi, m)) > LEVEL


@pytest.mark.parametrize("cos", [0.1, 1e-3])
def test_phong(cos: float) -> None:
    """About the mirror direction, drawn out by grazing incidence in the slopes of half vectors."""
    wi = directions.unit(cos, 0.0)
    width = 1 / np.sqrt(2 * N)
    assert p_value(B["phong"](), {"exponent": N}, wi, Slopes(wi, (width, width / cos))) > LEVEL


@pytest.mark.parametrize("cos", [0.7, 1e-2])
@pytest.mark.parametrize(
    ("name", "axis", "exponent"), [("kajiyakay", 0, N), pytest.param("grooved", 1, 1e4, marks=pytest.mark.slow)]
)
def test_cones(name: str, axis: int, exponent: float, cos: float) -> None:
    wi = directions.unit(cos, 0.4)
    assert p_value(B[name](), {"exponent": exponent}, wi, Cone(wi, 1 / np.sqrt(exponent), axis)) > LEVEL
