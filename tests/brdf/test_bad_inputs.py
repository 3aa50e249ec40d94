"""Inputs that are no direction above the surface, no number, or next to nothing: every model has a defined answer."""

from __future__ import annotations

import itertools
import math
from typing import Any

import drjit as dr
import numpy as np
import pytest

from brdf import Model, Param, Values, evaluate
from brdf.model import TANGENT
from brdf.models.cooktorrance import CookTorrance
from tests.brdf.arrays import VECTORS, Array, to_numpy
from tests.models import named, variations

WIDE = [kind for kind in VECTORS if "scalar" not in kind]
SCALAR = [kind for kind in VECTORS if "scalar" in kind]
#: Of Cook and Torrance's, anisotropic facets also with Smith's masking.
MODELS = [*variations(), CookTorrance(roughness="anisotropic", masking="smith", distribution="ggx")]
SMOOTH = [m for m in MODELS if not all(lobe.ideal for lobe in m.lobes)]
#: Parameters of ideal lobes, of which `evaluate` says nothing.
OF_IDEAL_LOBES = {("glazed", "specular_reflectance")}

#: Above the surface: the normal, oblique, grazing.
ABOVE = [(0, 0, 1), (0.6, 0, 0.8), (-0.6, 0, 0.8), (0, -0.96, 0.28), (0.8, 0.59, 0.11), (-1, 0, 1e-5)]
#: In the surface, or no direction at all. 5e-324 and 1e-310 are denormal in float64, 1e-45 and 1e-40 in float32.
TANGENTIAL = [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0.6, -0.8, -0.0), (1, 0, TANGENT), (0, 0, 1e-30)]
TANGENTIAL += [(side, 0, z) for side in (1, -1) for z in (5e-324, 1e-310, 1e-45, 1e-40, -1e-45, -1e-310)]
BELOW = [(0, 0, -1), (0.6, 0, -0.8), (1, 0, -1e-7), (-1, 0, -1e-12), (0.28, -0.96, -1e-3)]
#: From here on derivatives by directions are finite as well, in float32: half of what numbers below 1 are apart.
RESOLVED = 2.0**-25
#: Cosines next to nothing, and components of directions next to the normal.
SLIGHT = (5e-324, 1e-310, 1e-160, 1e-45, 1e-40, 1e-30, 1e-22, 1e-19, 1e-15, 1.2e-13, 1e-12, 1e-10, 1e-8, 3e-8, 1e-6)
#: Values of parameters, wherever the bounds are.
WILD = (-math.inf, -1e30, -1.0, 0.0, 1e-310, 1e-45, 1e-30, 1e30, 3.4028234e38, 1.7976931348623157e308, math.inf)

Rows = tuple[dict[str, Array], Array, Array]


def pairs(first: Any, second: Any) -> tuple[Array, Array]:
    """Every pair of two lists of directions, shapes (n, 3)."""
    i, o = zip(*itertools.product(first, second), strict=True)
    return np.array(i, dtype=float), np.array(o, dtype=float)


def joined(*some: tuple[Array, Array]) -> tuple[Array, Array]:
    i, o = zip(*some, strict=True)
    return np.concatenate(i), np.concatenate(o)


def usual(model: Model) -> dict[str, Array]:
    """Default values, shape () or (3,)."""
    return {
        p.name: np.resize(np.asarray(p.default, dtype=float), () if p.kind == "number" else (3,))
        for p in model.parameters()
    }


def at_each(settings: list[dict[str, Array]], wi: Array, wo: Array) -> Rows:
    """Every setting at every pair."""
    names, n = settings[0], len(wi)
    given = {k: np.repeat(np.array([s[k] for s in settings]), n, axis=0) for k in names}
    return given, np.tile(wi, (len(settings), 1)), np.tile(wo, (len(settings), 1))


def with_values(model: Model, of: Any) -> list[dict[str, Array]]:
    """The defaults, and with each parameter in turn at each of the values that `of` says of it."""
    base = usual(model)
    made = [base]
    for p in model.parameters():
        made += [{**base, p.name: np.full_like(base[p.name], value)} for value in of(p)]
    return made


def within_bounds(p: Param) -> list[float]:
    low, high = p.bounds
    return [low, high, *(x for x in SLIGHT if low < x < high)]


def answers(model: Model, kind: str, rows: Rows) -> dict[str, Array]:
    """The value, the derivative by each parameter and direction (reverse), and that along all (forward), (channels, n).

    Every input is an array, so that one kernel serves all rows.
    """
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    given, wi, wo = rows
    with np.errstate(over="ignore"):
        inputs = {k: number(v) if v.ndim == 1 else vector(v.T) for k, v in {**given, "wi": wi, "wo": wo}.items()}

    def traced() -> Any:
        dr.disable_grad(inputs)
        dr.enable_grad(inputs)
        return evaluate(model, Values(**{k: inputs[k] for k in given}), inputs["wi"], inputs["wo"])

    value = traced()
    for x in inputs.values():
        dr.set_grad(x, 1)
    along = dr.forward_to(value)
    dr.eval(value, along)
    dr.backward(dr.sum(traced()))
    found = {"value": value, "forward": along, **{name: dr.grad(x) for name, x in inputs.items()}}
    return {name: to_numpy(x).reshape(-1, len(wi)) for name, x in found.items()}


def off(found: dict[str, Array], rows: Rows, good: Any) -> list[str]:
    """Where an answer is not `good`: one line for each kind of answer."""
    given, wi, wo = rows
    said = []
    for name, x in found.items():
        bad = ~good(x).all(axis=0)
        if bad.any():
            k = int(np.argmax(bad))
            at = {key: v[k].tolist() for key, v in given.items()}
            said.append(f"{name}: {bad.sum()} of {bad.size}, {x[:, k]} at wi {wi[k]} wo {wo[k]} {at}")
    return said


def outside(model: Model) -> tuple[Array, Array]:
    """Pairs of which one direction is, or both are, where the model has nothing to say."""
    none = TANGENTIAL if model.transmits else TANGENTIAL + BELOW
    if model.transmits:
        return joined(pairs(none, ABOVE + BELOW), pairs(ABOVE + BELOW, none), pairs(none, none[:4]))
    return joined(pairs(none, ABOVE), pairs(ABOVE, none), pairs(none, none[:4]))


def inside(model: Model) -> tuple[Array, Array]:
    """Pairs of directions above the surface; of a model that transmits on both sides."""
    known = ABOVE + [(x, y, -z) for x, y, z in ABOVE] if model.transmits else ABOVE
    return pairs(known, known)


def unknown_directions(model: Model) -> list[tuple[Array, Array]]:
    """NaN in each component of either direction, by turns with the other inside and outside."""
    here = inside(model)
    none = pairs([(0.6, 0, -0.0)], ABOVE) if model.transmits else pairs(TANGENTIAL + BELOW, ABOVE)
    made = []
    for component in range(3):
        for side in (0, 1):
            for wi, wo in (here, none if side else none[::-1]):
                both = [wi.copy(), wo.copy()]
                both[side][:, component] = math.nan
                made.append((both[0], both[1]))
    return made


def moved_and_unknown(model: Model) -> list[dict[str, Array]]:
    """The defaults; then for each parameter another value, and NaN: of a colour in the first channel."""
    base = usual(model)
    settings = [base]
    for p in model.parameters():
        for other in (float(p.to_value(p.to_free(base[p.name].flat[0]) - 0.3)), math.nan):
            x = base[p.name].copy()
            x.flat[0] = other
            settings.append({**base, p.name: x})
    return settings


def next_to_the_surface() -> tuple[Array, Array]:
    near = [(x, y, z) for z in (*SLIGHT, 1e-3) for x, y in ((1, 0), (-1, 0), (-1, 1e-3), (0.28, 0.96))]
    return joined(pairs(near, near), pairs(near, ABOVE), pairs(ABOVE, near))


def next_to_the_normal() -> tuple[Array, Array]:
    off = [(a, 0) for a in SLIGHT] + [(0, a) for a in SLIGHT] + [(1e-9, 1e-22)]
    near = [(s * x, s * y, 1.0) for x, y in off for s in (1, -1)]
    return pairs(near, near)


def at_ends(p: Param) -> list[float]:
    return [b for b in p.bounds if math.isfinite(b)]


#: What is asked of every model. Together, since kernels take longer to compile than to run.
CASES = {
    "outside": lambda m: at_each(with_values(m, lambda p: [*within_bounds(p), *WILD, math.nan]), *outside(m)),
    "unknown directions": lambda m: at_each([usual(m)], *joined(*unknown_directions(m))),
    "unknown parameters": lambda m: at_each(moved_and_unknown(m), *inside(m)),
    "next to the surface": lambda m: at_each(with_values(m, at_ends), *next_to_the_surface()),
    "next to the normal": lambda m: at_each(with_values(m, at_ends), *next_to_the_normal()),
    "within bounds": lambda m: at_each(with_values(m, within_bounds), *inside(m)),
}

Asked = tuple[Model, dict[str, tuple[Rows, dict[str, Array]]]]


@pytest.fixture(scope="module", params=itertools.product(WIDE, SMOOTH), ids=lambda x: f"{x[0]}-{named(x[1])}")
def asked(request: pytest.FixtureRequest) -> Asked:
    """A model, and for each case what was asked and answered."""
    kind, model = request.param
    rows = {case: make(model) for case, make in CASES.items()}
    together = {k: np.concatenate([r[0][k] for r in rows.values()]) for k in usual(model)}
    found = answers(model, kind, (together, *joined(*(r[1:] for r in rows.values()))))
    ends = np.cumsum([len(r[1]) for r in rows.values()])[:-1]
    parts = zip(*(np.split(x, ends, axis=1) for x in found.values()), strict=True)
    return model, {
        c: (r, dict(zip(found, part, strict=True))) for (c, r), part in zip(rows.items(), parts, strict=True)
    }


def test_nothing_outside(asked: Asked) -> None:
    """Exactly 0, value and derivatives in both modes, with each parameter at its bounds and anywhere else."""
    rows, found = asked[1]["outside"]
    assert not off(found, rows, lambda x: x == 0)


def test_unknown_directions(asked: Asked) -> None:
    """NaN in a component of either is NaN, whether or not the lobes depend on it; but 0 with the other outside."""
    model, cases = asked
    rows, found = cases["unknown directions"]
    many = [len(wi) for wi, _ in unknown_directions(model)]
    lost = np.repeat(np.arange(len(many)) % 2 == 0, many)
    assert not off({"value": found["value"]}, rows, lambda x: np.isnan(x) == lost)
    assert not off({k: np.where(lost, 0, x) for k, x in found.items()}, rows, lambda x: x == 0)


def test_unknown_parameters(asked: Asked) -> None:
    """NaN in a parameter is NaN wherever the value moves with the parameter, in that channel of a colour alone."""
    model, cases = asked
    parameters, found = model.parameters(), cases["unknown parameters"][1]["value"]
    want, *others = found.reshape(3, 1 + 2 * len(parameters), -1).transpose(1, 0, 2)
    for p, moved, unknown in zip(parameters, others[::2], others[1::2], strict=True):
        channels = slice(0, 1 if p.kind == "colour" else 3)
        depends = (moved != want)[channels]
        assert depends.any() == ((model.name, p.name) not in OF_IDEAL_LOBES), p.name
        assert np.isnan(unknown[channels])[depends].all(), p.name
        np.testing.assert_array_equal(unknown[channels.stop :], want[channels.stop :])


def test_next_to_the_surface(asked: Asked) -> None:
    """Cosines from nothing up: value and derivatives by parameters are finite, by directions from `RESOLVED` on."""
    rows, found = asked[1]["next to the surface"]
    resolved = np.minimum(rows[1][:, 2], rows[2][:, 2]) > RESOLVED
    found = {k: np.where(resolved, x, 0) if k in ("forward", "wi", "wo") else x for k, x in found.items()}
    assert not off(found, rows, np.isfinite)
    assert (found["value"] >= 0).all()


def test_next_to_the_normal(asked: Asked) -> None:
    """Half vectors and directions by next to nothing off the normal, along either axis: all is finite."""
    rows, found = asked[1]["next to the normal"]
    assert not off(found, rows, np.isfinite)


def test_parameters_within_bounds(asked: Asked) -> None:
    """At the bounds, and next to nothing where that is allowed: all is finite, and no value is negative."""
    rows, found = asked[1]["within bounds"]
    assert not off(found, rows, np.isfinite)
    assert (found["value"] >= 0).all()


@pytest.mark.parametrize("model", SMOOTH, ids=named)
@pytest.mark.parametrize("kind", SCALAR)
def test_one_at_a_time(model: Model, kind: str) -> None:
    """The same on single numbers, where Python raises for what is 0/0 on arrays."""
    vector = VECTORS[kind]

    def value(given: dict[str, Array], wi: Any, wo: Any) -> Array:
        p = Values(**{k: vector(v.tolist()) if v.ndim else float(v) for k, v in given.items()})
        return to_numpy(evaluate(model, p, vector(*map(float, wi)), vector(*map(float, wo))))

    base = usual(model)
    for wi, wo in zip(*outside(model), strict=True):
        assert (value(base, wi, wo) == 0).all()
    for given in with_values(model, within_bounds):
        for wi, wo in zip(*inside(model), strict=True):
            assert np.isfinite(value(given, wi, wo)).all()
    for component in range(3):
        wi = np.array([0.6, 0, 0.8])
        wi[component] = math.nan
        assert np.isnan(value(base, wi, (0, -0.96, 0.28))).all()
        assert np.isnan(value(base, (0, -0.96, 0.28), wi)).all()
        assert (value(base, wi, (0, 1, 0)) == 0).all()


@pytest.mark.parametrize("model", [m for m in MODELS if any(lobe.ideal for lobe in m.lobes)], ids=named)
@pytest.mark.parametrize("kind", WIDE)
def test_unknown_parameters_of_ideal_lobes(model: Model, kind: str) -> None:
    """The weight of an ideal lobe is NaN wherever it moves with the parameter; where it goes stays a direction."""
    vector = VECTORS[kind]
    number = dr.value_t(vector)
    wi = vector(np.array(ABOVE, dtype=float).T)
    base = usual(model)

    def weights(given: dict[str, Array]) -> list[Array]:
        p = Values(**{k: vector(v) if v.ndim else dr.opaque(number, float(v)) for k, v in given.items()})
        dr.make_opaque(vars(p))
        sent = [model.ideal(p, wi, i) for i, lobe in enumerate(model.lobes) if lobe.ideal]
        return [to_numpy(vector(s.weight) + 0 * wi.z) for s in sent]

    for p in model.parameters():
        x = np.full_like(base[p.name], float(p.to_value(p.to_free(base[p.name].flat[0]) - 0.3)))
        want, moved = weights(base), weights({**base, p.name: x})
        got = weights({**base, p.name: np.full_like(x, math.nan)})
        assert all(np.isnan(g)[w != m].all() for g, w, m in zip(got, want, moved, strict=True)), p.name
