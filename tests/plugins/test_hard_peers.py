"""Mitsuba's own functions on our points: they are asked under their conventions, and judged as ours are."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import numpy.typing as npt
import pytest
from drjit.llvm.ad import Array3f

from brdf.hard import FORMULAS, Exact, Formula
from plugins.hard import peers
from plugins.peers import SMALLEST_ALPHA
from tests.oracles.exact import exact

Array = npt.NDArray[np.float64]

POINTS = 40


@cache
def found() -> dict[str, peers.Pair]:
    def answers(name: str) -> Exact:
        return exact(FORMULAS[name], FORMULAS[name].draw(5, POINTS))

    return dict(zip(peers.PEERS, peers.compare(answers), strict=True))


@pytest.mark.parametrize("name", peers.PEERS)
def test_same_function(name: str) -> None:
    """At most points hardly anything is between them: alpha, cosines and factors are as they take them."""
    mi.set_variant(peers.VARIANT)
    formula, function = FORMULAS[peers.PEERS[name][0]], peers.PEERS[name][1]
    inputs = tame(formula)
    ours, theirs = value(formula.function, formula, inputs), value(function, formula, inputs)
    assert np.isfinite(theirs).all()
    lit = ours > 1e-10
    assert lit.sum() > 20
    off = np.abs(theirs[lit] / ours[lit] - 1)
    assert np.quantile(off, 0.75) < 0.005  # more than their fit of Smith's masking is off


@pytest.mark.parametrize("name", peers.PEERS)
def test_judged_on_the_same_points(name: str) -> None:
    ours, theirs = found()[name]
    assert ours.passed, ours.sentence()
    assert theirs.name == name
    assert theirs.points == ours.points > POINTS / 3


def test_what_is_known_of_them() -> None:
    """Their GGX is as good as ours; their masking of Beckmann's facets is a fit."""
    for name in ("MicrofacetDistribution.eval, GGX", "MicrofacetDistribution.smith_g1, GGX"):
        assert found()[name].theirs.passed, found()[name].theirs.sentence()
    fit = found()["MicrofacetDistribution.smith_g1, Beckmann"].theirs.value
    assert 1e3 < fit < 0.005 * 2**23  # half a per cent


def test_refuses_what_they_replace() -> None:
    """Roughness up to their least is left out: there their derivative is 0."""
    formula = FORMULAS["beckmann_d"]
    inputs = np.repeat(formula.draw(1, 1), 3, axis=1)
    inputs[formula.inputs.index("m")] = np.array([0.99 * SMALLEST_ALPHA, SMALLEST_ALPHA, 0.1], dtype=np.float32)
    assert len(peers.accepted(formula, exact(formula, inputs, processes=1))) == 1


def test_a_parameter_for_each_point() -> None:
    """Of a BSDF asked with arrays: the same as asked point by point."""
    mi.set_variant(peers.VARIANT)
    name, function = peers.PEERS["roughconductor"]
    formula = FORMULAS[name]
    inputs = tame(formula)[:, :8]
    alone = [value(function, formula, inputs[:, [i, i]])[0] for i in range(8)]
    np.testing.assert_allclose(value(function, formula, inputs), alone, rtol=1e-6)


def tame(formula: Formula) -> Array:
    """Points of moderate roughness and index."""
    inputs = formula.draw(5, 200)
    for name, x in (("m", 0.3), ("m_u", 0.2), ("m_v", 0.4), ("eta", 1.5), ("k", 2.0)):
        if name in formula.inputs:
            inputs[formula.inputs.index(name)] = np.float32(x * np.linspace(0.9, 1.1, 200))
    return inputs


def value(function: peers.Function, formula: Formula, inputs: Array) -> Array:
    """In float32."""
    names = [name.replace(".", "_") for name in formula.inputs]
    v = SimpleNamespace(**{name: mi.Float(x) for name, x in zip(names, inputs, strict=True)})
    return np.array(function(Array3f, v), dtype=float)
