"""Any `brdf.Model` as a Mitsuba BSDF plugin."""

from __future__ import annotations

import difflib
import itertools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf import Lobe, Model, Param, UsageError, Values
from brdf.model import opposite, unknown, unlit

from . import indices

FLAGS = {
    Lobe.DIFFUSE: "DiffuseReflection",
    Lobe.GLOSSY: "GlossyReflection",
    Lobe.MIRROR: "DeltaReflection",
    Lobe.DIFFUSE_TRANSMISSION: "DiffuseTransmission",
    Lobe.GLOSSY_TRANSMISSION: "GlossyTransmission",
    Lobe.REFRACTION: "DeltaTransmission",
    # Not Null: where that is sampled and no environment is behind, `path` drops what the other lobes sent as well.
    Lobe.STRAIGHT: "DeltaTransmission",
}
#: The largest float32 below 1: a random number stays inside [0, 1).
BELOW_ONE = 1 - 2.0**-24
#: Where the components of an RGB triple that is no reflectance lie in a spectrum, and where Mitsuba's spectra end [nm].
RGB_AT, SEEN = (650.0, 550.0, 450.0), (360.0, 830.0)
ACCEPTED = {"Float", "Integer", "Color", "Spectrum", "Object", "ResolvedReference"}


def plugin_class(model_class: type[Model]) -> type[Any]:
    """The class of Mitsuba plugin that wraps `model_class`, for the variant now set.

    ``mi.BSDF`` is another class in each variant, so each needs its own.
    """

    class Plugin(mi.BSDF):
        """``eval`` is ``f cos``; every parameter is a texture, so a number, a colour, a spectrum or an image."""

        def __init__(self, props: mi.Properties) -> None:
            mi.BSDF.__init__(self, props)
            self.model, self.textures = read(model_class, props)
            extra = mi.BSDFFlags.FrontSide
            if self.model.transmits:
                extra = extra | mi.BSDFFlags.BackSide
            if self.model.anisotropic:
                extra = extra | mi.BSDFFlags.Anisotropic
            if any(t.is_spatially_varying() for t in self.textures.values()):
                extra = extra | mi.BSDFFlags.SpatiallyVarying
            refracts = {Lobe.REFRACTION: mi.BSDFFlags.NonSymmetric}
            self.m_components = [
                flag_of(lobe) | extra | refracts.get(lobe, mi.BSDFFlags.Empty) for lobe in self.model.lobes
            ]
            self.m_flags = 0
            for component in self.m_components:
                self.m_flags |= component

        def traverse(self, callback: mi.TraversalCallback) -> None:
            for name, texture in self.textures.items():
                callback.put(name, texture, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: list[str] | None = None) -> None:
            pass

        def to_string(self) -> str:
            made = [f"{p.name} = {getattr(self.model, p.name)}" for p in self.model.params if p.kind == "choice"]
            made += [f"{name} = {' '.join(str(t).split())}" for name, t in self.textures.items()]
            return f"{self.model.name}[{', '.join(made)}]"

        def values(self, si: mi.SurfaceInteraction3f, active: Any) -> Values:
            """Parameters at the hit points."""
            return Values(
                **{
                    p.name: (self.textures[p.name].eval_1 if p.kind == "number" else self.textures[p.name].eval)(
                        si, active
                    )
                    for p in self.model.parameters()
                }
            )

        def enabled(self, ctx: mi.BSDFContext) -> list[bool]:
            return [ctx.is_enabled(flag_of(lobe), i) for i, lobe in enumerate(self.model.lobes)]

        def value(self, p: Values, wi: Any, wo: Any, on: list[bool]) -> Any:
            """``f cos`` of the smooth lobes that are on."""
            total = mi.UnpolarizedSpectrum(unknown(wi, wo))
            if any(o and not lobe.ideal for o, lobe in zip(on, self.model.lobes, strict=True)):
                for f, o, lobe in zip(self.model.f(p, wi, wo), on, self.model.lobes, strict=True):
                    if o and not lobe.ideal:
                        total += self.on_its_side(lobe, wi, wo, f)
            return total * (dr.abs(wo.z) if self.model.transmits else wo.z)

        def density(self, p: Values, wi: Any, wo: Any, chances: list[Any]) -> Any:
            """Without gradient: with one in `eval_pdf` but none in `sample`, the two weights of multiple importance
            sampling would not add up to a constant, and a derivative through ``direct`` was seen 75 % off."""
            total = mi.Float(0)
            if any(c is not None and not lobe.ideal for c, lobe in zip(chances, self.model.lobes, strict=True)):
                for q, c, lobe in zip(self.model.pdf(p, wi, wo), chances, self.model.lobes, strict=True):
                    if c is not None and not lobe.ideal:
                        total += self.on_its_side(lobe, wi, wo, q) * c
            return dr.detach(total)

        def on_its_side(self, lobe: Lobe, wi: Any, wo: Any, x: Any) -> Any:
            """`x`, and 0 where a lobe that reflects is asked about the other side, or one that transmits about this."""
            return dr.select(opposite(wi, wo) == lobe.transmits, x, 0) if self.model.transmits else x

        def sides(self, wi: Any, wo: Any, active: Any) -> tuple[Any, Any, Any]:
            """Where the model is asked for these directions; elsewhere they are made harmless, before anyone divides
            by them."""
            good = dr.select(unlit(self.model, wi, wo), False, active)
            return good, *(mi.Vector3f(w.x, w.y, dr.select(good, w.z, 1)) for w in (wi, wo))

        def chances(self, p: Values, wi: Any, on: list[bool]) -> list[Any]:
            """Probability of each lobe, None for one that is switched off. Without gradient."""
            if sum(on) == 1:
                return [1.0 if o else None for o in on]
            weights = [dr.detach(w) if o else None for w, o in zip(self.model.choose(p, wi), on, strict=True)]
            total = sum((w for w in weights if w is not None), mi.Float(0))
            black = total <= 0
            scale = 1 / dr.select(black, 1, total)
            even = 1 / sum(on)
            return [None if w is None else dr.select(black, even, w * scale) for w in weights]

        def eval(self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True) -> Any:
            on = self.enabled(ctx)
            if not any(on):
                return mi.Spectrum(0)
            active, wi, wo = self.sides(si.wi, wo, active)
            return mi.depolarizer(self.value(self.values(si, active), wi, wo, on)) & active

        def pdf(self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True) -> Any:
            on = self.enabled(ctx)
            if not any(on):
                return mi.Float(0)
            active, wi, wo = self.sides(si.wi, wo, active)
            p = self.values(si, active)
            return dr.select(active, self.density(p, wi, wo, self.chances(p, wi, on)), 0)

        def eval_pdf(
            self, ctx: mi.BSDFContext, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Any = True
        ) -> tuple[Any, Any]:
            on = self.enabled(ctx)
            if not any(on):
                return mi.Spectrum(0), mi.Float(0)
            active, wi, wo = self.sides(si.wi, wo, active)
            p = self.values(si, active)
            value = mi.depolarizer(self.value(p, wi, wo, on)) & active
            return value, dr.select(active, self.density(p, wi, wo, self.chances(p, wi, on)), 0)

        def sample(
            self,
            ctx: mi.BSDFContext,
            si: mi.SurfaceInteraction3f,
            sample1: Any,
            sample2: mi.Point2f,
            active: Any = True,
        ) -> tuple[mi.BSDFSample3f, Any]:
            """Choose a lobe, then a direction from it; weight ``f cos / pdf`` with the pdf of all smooth lobes.

            Of a smooth lobe, direction and pdf carry no gradient, the value does: the derivative of the estimate is
            then unbiased. Of an ideal lobe the direction moves with the parameters, so it carries its gradient.
            """
            bs = dr.zeros(mi.BSDFSample3f)
            on = self.enabled(ctx)
            if not any(on):
                return bs, mi.Spectrum(0)
            lobes = self.model.lobes
            active, wi, _ = self.sides(si.wi, mi.Vector3f(0, 0, 1), active)
            p = self.values(si, active)
            chances = self.chances(p, wi, on)
            fixed = Values(**{name: dr.detach(v) for name, v in vars(p).items()})
            still = dr.detach(wi)

            lobe, rest = mi.UInt32(0), mi.Float(sample1)
            start = mi.Float(0)
            last = max(i for i, o in enumerate(on) if o)
            for i, chance in enumerate(chances):
                if chance is None:
                    continue
                end = start + chance
                here = (sample1 >= start) & ((sample1 < end) | mi.Bool(i == last))
                lobe = dr.select(here, mi.UInt32(i), lobe)
                within = (sample1 - start) / dr.select(here & (chance > 0), chance, 1)
                rest = dr.select(here, dr.clip(within, 0, BELOW_ONE), rest)
                start = end
            bs.eta = 1
            bs.sampled_component = lobe
            bs.sampled_type = mi.UInt32(0)
            for i, kind in enumerate(lobes):
                bs.sampled_type = dr.select(lobe == i, mi.UInt32(int(flag_of(kind))), bs.sampled_type)

            u = mi.Vector3f(sample2.x, sample2.y, rest)
            wo, smooth = mi.Vector3f(0, 0, 1), mi.Bool(False)
            for i, o in enumerate(on):
                if o and not lobes[i].ideal:
                    wo = dr.select(lobe == i, self.model.sample(fixed, still, u, i), wo)
                    smooth |= lobe == i
            value = mi.UnpolarizedSpectrum(0)
            if any(o and not kind.ideal for o, kind in zip(on, lobes, strict=True)):
                wo = mi.Vector3f(dr.detach(wo))
                good, i_safe, o_safe = self.sides(wi, wo, active & smooth)
                pdf = self.density(fixed, still, o_safe, chances)
                good &= pdf > 0
                value = self.value(p, i_safe, o_safe, on) / dr.select(good, pdf, 1) & good
                bs.pdf = dr.select(good, pdf, 0)
            for i, chance in enumerate(chances):
                if chance is None or not lobes[i].ideal:
                    continue
                ideal = self.model.ideal(p, wi, i)
                here = active & (lobe == i) & (chance > 0)
                weight = mi.UnpolarizedSpectrum(ideal.weight) / dr.select(here, chance, 1)
                if lobes[i] is Lobe.REFRACTION and ctx.mode == mi.TransportMode.Radiance:
                    weight /= dr.square(ideal.eta)  # radiance is compressed on the way into a denser medium
                wo = dr.select(here, mi.Vector3f(ideal.wo), wo)
                value = dr.select(here, weight, value)
                bs.pdf = dr.select(here, chance, bs.pdf)
                bs.eta = dr.select(here, dr.detach(ideal.eta), bs.eta)
            bs.wo = wo
            return bs, mi.depolarizer(value) & active

    Plugin.__name__ = Plugin.__qualname__ = model_class.__name__
    return Plugin


def flag_of(lobe: Lobe) -> Any:
    """Mitsuba's flag for a lobe."""
    return getattr(mi.BSDFFlags, FLAGS[lobe])


def read(model_class: type[Model], props: mi.Properties) -> tuple[Model, dict[str, mi.Texture]]:
    """The model with its choices made, and a texture for each parameter, from the properties in a scene.

    Raises
    ------
    UsageError
        An unknown property or choice, a value of the wrong kind or outside its bounds: one line.
    """
    name, choices = model_class.name, {}
    replaced = indices.resolve(model_class, props)
    declared = {p.name: p for p in model_class.params}
    for key in props.keys():  # noqa: SIM118  (mi.Properties does not iterate)
        if key not in declared:
            near = difflib.get_close_matches(key, declared, 1)
            guess = f"Did you mean {near[0]}? " if near else ""
            raise UsageError(
                f"{name}: {key!r} is not a parameter of this model. {guess}It has: {', '.join(declared) or 'none'}."
            )
        if declared[key].kind == "choice":
            choices[key] = props[key]
            if not isinstance(choices[key], str):
                raise UsageError(f"{name}: {key} takes a <string>: one of {', '.join(declared[key].options)}.")
    model = choose(model_class, choices, [key for key in props.keys() if key not in choices])  # noqa: SIM118
    parameters = {p.name: p for p in model.parameters()}
    if "eta" in parameters and parameters["eta"].kind == "colour" and set(replaced) & set(indices.MEDIA):
        raise UsageError(
            f"{name}: {' and '.join(replaced)} make it a dielectric. A conductor takes eta and k, or material."
        )
    for key in props.keys():  # noqa: SIM118
        if key not in parameters and key not in choices:
            made = ", ".join(f"{p.name} = {getattr(model, p.name)}" for p in model.params if p.kind == "choice")
            raise UsageError(
                f"{name}: {key!r} is not a parameter with {made}. It has: {', '.join(parameters) or 'none'}."
            )
    return model, {p.name: texture(name, p, props) for p in parameters.values()}


def choose(model_class: type[Model], choices: dict[str, str], given: list[str]) -> Model:
    """The model with these choices. Those left open follow from which parameters are given: `k` makes a conductor.

    The first options, in the order declared, under which all given parameters exist; the defaults if there are none.
    """
    free = {p.name: p.options for p in model_class.params if p.kind == "choice" and p.name not in choices}
    for options in itertools.product(*free.values()):
        model = model_class(**choices, **dict(zip(free, options, strict=True)))
        if {p.name for p in model.parameters()}.issuperset(given):
            return model
    return model_class(**choices)


def texture(owner: str, p: Param, props: mi.Properties) -> mi.Texture:
    """The texture of one parameter, its values checked where they can be known."""
    given = props[p.name] if p.name in props else p.default
    kind = props.type(p.name).name if p.name in props else "Color" if p.kind == "colour" else "Float"
    if kind not in ACCEPTED or (isinstance(given, mi.Object) and not isinstance(given, mi.Texture)):
        got = type(given).__name__ if isinstance(given, mi.Object) else kind.lower()
        raise UsageError(f"{owner}: {p.name} is given as {got}. It takes a {p.kind} in {p.range_text()} or a texture.")
    if p.kind == "number" and kind in ("Color", "Spectrum"):
        got = "a colour" if kind == "Color" else "a spectrum"
        raise UsageError(f"{owner}: {p.name} is given as {got}. It takes one number in {p.range_text()} or a texture.")
    if kind in ("Float", "Integer", "Color"):
        p.check(owner, [float(c) for c in given] if kind == "Color" else float(given))
        if p.kind == "colour":
            # Three components that can be told apart, rather than one grey.
            rgb = [float(c) for c in given] if kind == "Color" else [float(given)] * 3
            if mi.is_rgb:
                props[p.name] = mi.ScalarColor3d(*rgb)
            elif len(set(rgb)) == 1:
                props[p.name] = rgb[0]
            elif mi.is_spectral and p.bounds[1] > 1:
                props[p.name] = spectrum(rgb)
            else:
                props[p.name] = mi.ScalarColor3d(*rgb)
    make = props.get_texture if p.bounds[1] <= 1 else props.get_unbounded_texture
    made = make(p.name) if p.name in props else make(p.name, float(p.default))
    if kind not in ("Float", "Integer", "Color"):
        check_texture(owner, p, made)
    return made


def spectrum(rgb: list[float]) -> mi.Texture:
    """A spectrum through an RGB triple that may exceed 1: Mitsuba's own, made for reflectances, would end there."""
    red, green, blue = rgb
    points = dict(zip((SEEN[0], *RGB_AT[::-1], SEEN[1]), (blue, blue, green, red, red), strict=True))
    wavelengths, values = (", ".join(map(repr, numbers)) for numbers in (points.keys(), points.values()))
    return mi.load_dict({"type": "irregular", "wavelengths": wavelengths, "values": values})  # type: ignore[return-value]


def check_texture(owner: str, p: Param, made: mi.Texture) -> None:
    """Check the numbers inside a texture against the bounds of the parameter (none where they cannot be seen)."""
    params = mi.traverse(made)
    for key in params.keys():  # noqa: SIM118
        leaf = key.rsplit(".", 1)[-1]
        if leaf not in ("data", "value", "values"):
            continue
        values = np.asarray(params[key], dtype=float)
        if mi.is_spectral and ((leaf == "data" and values.shape[-1] == 3) or (leaf == "value" and values.size == 3)):
            if p.bounds[1] > 1:
                raise UsageError(
                    f"{owner}: {p.name} is given as RGB in a texture, which {mi.variant()} takes for reflectances and "
                    "cuts off at 1. Give a number, a colour or a spectrum, or set an RGB variant."
                )
            continue  # coefficients of a spectrum made from RGB, not values
        p.check(f"{owner}: in the texture", values)
    if dr.is_jit_v(mi.Float):
        # Not every texture can be asked for one number, or for a colour in this variant. This traces, it computes
        # nothing.
        try:
            (made.eval_1 if p.kind == "number" else made.eval)(dr.zeros(mi.SurfaceInteraction3f))
        except RuntimeError as error:
            said = " ".join(str(error).split())
            raise UsageError(f"{owner}: {p.name} takes a {p.kind}, which this texture does not give: {said}") from None
