"""Every model of brdf.models, by what it declares; and the interface itself."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any

import drjit as dr
import drjit.llvm.ad as wide
import drjit.scalar as scalar
import numpy as np
import pytest

import brdf
from brdf import Lobe, Model, UsageError, builtin, defaults, evaluate
from brdf.models.cooktorrance import CookTorrance
from brdf.models.lambertian import Lambertian
from tests.brdf.arrays import VECTORS, call, to_numpy
from tests.models import named
from tests.oracles import directions
from tests.toys import Paper

FOLDER = Path(brdf.__file__).parent
KEY = re.compile(r"\b[a-z]+(?:19|20|18|17)\d\d[a-z]?\b")


#: Choices that act on each other: every combination of them is tried. Of the others, each option once.
TOGETHER = {"masking", "distribution", "roughness"}


def instances() -> list[Model]:
    """Every model with every option of its choices, and every combination of those that act on each other."""
    made: list[Model] = [Paper()]
    for model in builtin().values():
        options = {p.name: p.options for p in model.params if p.kind == "choice"}
        usual = {name: known[0] for name, known in options.items()}
        several = {name: known for name, known in options.items() if name in TOGETHER}
        made += [model(**{**usual, **dict(zip(several, c, strict=True))}) for c in itertools.product(*several.values())]
        made += [
            model(**{**usual, name: option})
            for name, known in options.items()
            if name not in TOGETHER
            for option in known[1:]
        ]
    return made


every = pytest.mark.parametrize("model", instances(), ids=named)


def test_found_by_file() -> None:
    files = {path.stem for path in (FOLDER / "models").glob("*.py")} - {"__init__"}
    assert set(builtin()) == files >= {"cooktorrance", "lambertian"}


@pytest.mark.parametrize("model", builtin().values(), ids=lambda m: m.name)
def test_declaration(model: type[Model]) -> None:
    assert model.name.isidentifier() and model.name == model.name.lower()
    assert model.summary and not model.summary.endswith(".")
    assert model.source
    assert all(isinstance(lobe, Lobe) for lobe in model.lobes)
    kinds = [p.kind == "choice" for p in model.params]
    assert kinds == sorted(kinds), "numbers and colours, then choices"
    for p in model.params:
        assert p.meaning, p.name
        assert re.fullmatch("[a-z][a-z0-9_]*", p.name)
        p.check(model.name, p.default)


@every
@pytest.mark.parametrize("vector", [wide.Array3f, wide.Array3f64, scalar.Array3f, scalar.Array3f64])
def test_an_entry_for_each_lobe(model: Model, vector: Any) -> None:
    """Also: written once, it runs in every precision, on one direction or many."""
    p = defaults(model, vector)
    w, v = vector(0.6, 0, 0.8), vector(0, 0.28, 0.96)
    for returned in (model.f(p, w, v), model.pdf(p, w, v), model.choose(p, w)):
        assert isinstance(returned, tuple)
        assert len(returned) == len(model.lobes)
    for i, lobe in enumerate(model.lobes):
        if lobe.ideal:
            sent = model.ideal(p, w, i)
            assert type(sent.wo) is vector
            assert (to_numpy(sent.wo)[2] < 0).all() == lobe.transmits
            assert np.sum(to_numpy(sent.wo) ** 2) == pytest.approx(1, abs=1e-6)
            assert np.all((to_numpy(sent.weight) >= 0) & (to_numpy(sent.weight) <= 1))
        else:
            drawn = model.sample(p, w, vector(0.1, 0.2, 0.3), i)
            assert type(drawn) is vector
            assert (to_numpy(drawn)[2] < 0).all() == lobe.transmits
    assert type(evaluate(model, p, w, v)) is vector
    reflects = any(not lobe.ideal and not lobe.transmits for lobe in model.lobes)
    passes = any(not lobe.ideal and lobe.transmits for lobe in model.lobes)
    assert (to_numpy(evaluate(model, p, w, v)) > 0).all() == reflects
    if dr.is_jit_v(vector):
        back = vector(0, 0.28, -0.96)
        assert (to_numpy(evaluate(model, p, w, back)) != 0).any() == passes


@every
def test_scalar_and_wide_agree(model: Model) -> None:
    wi, wo, _ = directions.grid((0.3,))

    def f(i: Any, o: Any) -> Any:
        return evaluate(model, defaults(model, i), i, o).x

    np.testing.assert_allclose(
        call(f, VECTORS["float64"], wi, wo), call(f, VECTORS["float64-scalar"], wi, wo), rtol=1e-13, atol=1e-300
    )


@every
def test_sampling_density_is_normalised(model: Model) -> None:
    """Each smooth lobe's density integrates to 1, less what is sampled on the side where the lobe is not."""
    vector = VECTORS["float64"]
    n = 400
    z, phi = (np.arange(n) + 0.5) / n, (np.arange(2 * n) + 0.5) * np.pi / n
    mu, angle = (a.ravel() for a in np.meshgrid(z, phi, indexing="ij"))
    sin = np.sqrt(1 - mu**2)
    u = vector(*np.random.default_rng(2).random((3, 1 << 18)))
    for cos in (1.0, 0.6, 0.2, -0.6) if model.transmits else (1.0, 0.6, 0.2):
        wi = vector(*directions.unit(cos, 0.5).tolist())
        p = defaults(model, vector)
        for i, lobe in enumerate(model.lobes):
            if lobe.ideal:
                continue
            side = np.sign(cos) * (-1 if lobe.transmits else 1)
            wo = vector(sin * np.cos(angle), sin * np.sin(angle), side * mu)
            density = to_numpy(model.pdf(p, wi, wo)[i])
            lost = (side * to_numpy(model.sample(p, wi, u, i))[2] <= 0).mean()
            total = np.sum(density) * (1 / n) * (np.pi / n)
            assert total + lost == pytest.approx(1, abs=0.005)


def test_lambertian() -> None:
    """reflectance / pi whatever the directions, and it reflects its reflectance."""
    vector = VECTORS["float64"]
    wi, wo = (directions.hemisphere(100, seed) for seed in (1, 2))
    p = defaults(Lambertian(), vector, reflectance=(0.2, 0.4, 0.8))
    f = to_numpy(evaluate(Lambertian(), p, vector(*wi.T), vector(*wo.T)))
    np.testing.assert_allclose(f, np.array([[0.2], [0.4], [0.8]]) / np.pi * np.ones((1, 100)), rtol=1e-15)
    density = to_numpy(Lambertian().pdf(p, vector(*wi.T), vector(*wo.T))[0])
    np.testing.assert_allclose(density, wo[:, 2] / np.pi, rtol=1e-15)


def test_choices() -> None:
    assert CookTorrance().fresnel == "exact"
    assert CookTorrance(fresnel="schlick", masking="smith").masking == "smith"
    assert [p.name for p in CookTorrance(fresnel="constant").parameters()] == [
        "diffuse_reflectance",
        "specular_reflectance",
        "m",
    ]
    options = "exact, schlick, constant, conductor"
    with pytest.raises(UsageError, match=rf"^cooktorrance: fresnel = 'snell' is not one of {options}\.$"):
        CookTorrance(fresnel="snell")
    known = "fresnel, masking, distribution, roughness, normalization"
    with pytest.raises(
        UsageError, match=rf"^cooktorrance: 'fresnell' is not a choice of this model\. It has: {known}\.$"
    ):
        CookTorrance(fresnell="exact")
    metal = {p.name: p for p in CookTorrance(fresnel="conductor").parameters()}
    assert list(metal) == ["diffuse_reflectance", "specular_reflectance", "m", "eta", "k"]
    assert (metal["eta"].kind, metal["eta"].bounds) == ("colour", (0.0, 20.0))
    brushed = {p.name: p for p in CookTorrance(roughness="anisotropic", distribution="blinn").parameters()}
    assert list(brushed) == ["diffuse_reflectance", "specular_reflectance", "m_u", "m_v", "eta"]
    assert brushed["m_u"].bounds == (1e-4, 1.0)
    assert CookTorrance(roughness="anisotropic").anisotropic and not CookTorrance().anisotropic
    with pytest.raises(UsageError, match=r"^lambertian: 'x' is not a choice of this model. It has: none\.$"):
        Lambertian(x="y")


def test_values() -> None:
    vector = VECTORS["float32"]
    p = defaults(CookTorrance(), vector, m=0.2, diffuse_reflectance=0.25)
    assert to_numpy(p.m) == np.float32(0.2)
    assert to_numpy(p.eta) == 1.5
    assert to_numpy(p.diffuse_reflectance).ravel().tolist() == [0.25] * 3
    m = wide.Float([0.1, 0.2])
    assert to_numpy(defaults(CookTorrance(), vector, m=m).m).tolist() == to_numpy(m).tolist()
    with pytest.raises(UsageError, match=r"^cooktorrance: m = 1\.7 is outside"):
        defaults(CookTorrance(), vector, m=1.7)
    with pytest.raises(
        UsageError, match=r"^cooktorrance: 'n' is not a parameter of this model. It has: diffuse_reflec"
    ):
        defaults(CookTorrance(), vector, n=1.7)


def test_f_is_asked_for() -> None:
    class Empty(Model):
        name = "empty"

    with pytest.raises(NotImplementedError, match="empty: f is not written"):
        Empty().f(brdf.Values(), None, None)


def cited() -> dict[str, set[str]]:
    """Keys of references.bib used in each file: in docstrings under "References", and as a model's source."""
    found: dict[str, set[str]] = {}
    for folder in (FOLDER, FOLDER.parent / "plugins", FOLDER.parent / "fitting"):
        for path in folder.rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            sections = re.findall(r"References\n\s*-{4,}\n(.*?)(?=\n\s*\n|\"\"\")", text, re.DOTALL)
            sections += re.findall(r"^    source = \((.*?)\)$", text, re.DOTALL | re.MULTILINE)
            if keys := set(KEY.findall(" ".join(sections))):
                found[str(path.relative_to(FOLDER.parent))] = keys
    return found


def test_references() -> None:
    """Every key that is cited is in references.bib once; every entry says who, what, where and when, and is cited."""
    text = (FOLDER / "references.bib").read_text(encoding="utf-8")
    entries = dict(re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", text, re.DOTALL | re.MULTILINE))
    assert len(entries) == text.count("@")
    uses = cited()
    assert uses["brdf/models/cooktorrance.py"] >= {"cook1982", "torrance1967", "walter2007", "heitz2014"}
    assert {f"{path}: {key}" for path, keys in uses.items() for key in keys if key not in entries} == set()
    assert set(entries) - set().union(*uses.values()) == set()
    for key, body in entries.items():
        fields = dict(re.findall(r"^  (\w+) = \{(.*)\},$", body, re.MULTILINE))
        assert {"author", "title", "year"} <= set(fields), key
        assert {"journal", "booktitle", "publisher"} & set(fields), key
        assert key.endswith(fields["year"])
