"""Any BSDF in Mitsuba as the checks ask it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf import UsageError
from brdf.checks.directions import hemisphere, stratified
from brdf.checks.subject import Part, Quantity, Sample, Subject, shell_line
from brdf.checks.values import channels

from ..registry import registered

#: Wavelengths of the spectral variants [nm].
WAVELENGTHS = (450.0, 520.0, 590.0, 660.0)
#: Pairs of directions and samples by which is seen whether the lobes of a BSDF can be asked one by one, and the
#: relative difference that still is rounding.
TRIED, SAME = 512, 1e-3
#: Rows of samples that are tried, squared.
SIDE = 16


class BsdfSubject(Subject):
    """A BSDF at the middle of its textures, through ``eval``, ``pdf`` and ``sample``.

    Its lobes are its components. Where it does not keep them apart when asked for one, they are taken as one part.

    Parameters
    ----------
    bsdf : mi.BSDF
    name : str
        What it is called: its type or its id.
    settings : dict
        Plain values that make it, for the case.
    line : str
        A command for the shell that checks it.

    Raises
    ------
    UsageError
        In a scalar variant.
    """

    def __init__(
        self, bsdf: mi.BSDF, name: str = "", settings: Mapping[str, Any] | None = None, line: str = ""
    ) -> None:
        if not dr.is_jit_v(mi.Float):
            raise UsageError(
                f"check: the variant {mi.variant()} has no arrays. Set llvm_ad_rgb, or another llvm or cuda variant."
            )
        self.bsdf, self.line = bsdf, line
        self.name = name or bsdf.id() or type(bsdf).__name__
        self.vector = mi.Vector3f
        self.settings = dict(settings or {})
        self.params = mi.traverse(bsdf)
        self.anisotropic = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Anisotropic)
        self.back = can_be_below(bsdf)
        flags = [int(bsdf.flags(i)) for i in range(bsdf.component_count())]
        front = [i for i, flag in enumerate(flags) if flag & int(mi.BSDFFlags.FrontSide) or not sided(flag)]
        shown = front if front and not self.back else list(range(len(flags)))
        self.components: list[int | None] = list(shown)
        self.lobes = tuple(part_of(n, [flags[i]]) for n, i in enumerate(shown))
        if len(shown) > 1 and not self.apart():
            self.components = [None]
            self.lobes = (part_of(0, [flags[i] for i in shown]),)

    def context(self, lobe: int | None, mode: Any) -> mi.BSDFContext:
        context = mi.BSDFContext(mode)
        component = None if lobe is None else self.components[lobe]
        if component is not None:
            context.component = component
        return context

    def value(self, wi: Any, wo: Any, lobe: int | None, mode: Any) -> Any:
        value = self.bsdf.eval(self.context(lobe, mode), interaction(wi), wo)
        z = dr.abs(wo.z)
        return mi.unpolarized_spectrum(value) / dr.select(z > 0, z, 1)

    def f(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        return self.value(wi, wo, lobe, mi.TransportMode.Radiance)

    def adjoint(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        return self.value(wi, wo, lobe, mi.TransportMode.Importance)

    def pdf(self, wi: Any, wo: Any, lobe: int | None = None) -> Any:
        return self.bsdf.pdf(self.context(lobe, mi.TransportMode.Importance), interaction(wi), wo) + 0 * wo.z

    def sample(self, wi: Any, u: Any, lobe: int | None = None) -> Sample:
        context = self.context(lobe, mi.TransportMode.Importance)
        bs, weight = self.bsdf.sample(context, interaction(wi), u.z, mi.Point2f(u.x, u.y))
        weight = mi.unpolarized_spectrum(weight)
        ideal = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) | mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        return Sample(bs.wo, weight, bs.pdf, bs.sampled_component, ideal & (bs.pdf > 0), bs.eta)

    def quantities(self) -> tuple[Quantity, ...]:
        return tuple(Quantity(name, self.bounds(name)) for name in differentiable(self.params))

    def bounds(self, name: str) -> tuple[float, float]:
        """The range of one of our parameters; that of another is not known."""
        model = registered().get(getattr(getattr(self.bsdf, "model", None), "name", ""))
        for p in model.params if model else ():
            if name == f"{p.name}.value":
                return p.bounds
        return -math.inf, math.inf

    def get(self, name: str) -> Any:
        value = self.params[name]
        return type(value)(value)  # what Mitsuba returns is changed by the next `set`

    def set(self, name: str, value: Any) -> None:
        kind = type(self.params[name])
        self.params[name] = value if isinstance(value, kind) else kind(value)
        self.params.update()

    def command(self) -> str:
        return self.line

    def apart(self) -> bool:
        """Whether asking for one component gives that component: the values add up, and samples are of its kind."""
        rng = np.random.default_rng(0)
        wi, wo = hemisphere(TRIED, rng), hemisphere(TRIED, rng)
        if self.transmits:
            wo[2] *= np.where(rng.random(TRIED) < 0.5, -1, 1)
        i, o = mi.Vector3f(wi), mi.Vector3f(wo)
        numbers = range(len(self.lobes))
        try:
            total = channels(self.f(i, o))
            added = sum(channels(self.f(i, o, n)) + np.zeros_like(total) for n in numbers)
            if np.abs(added - total).max() > SAME * np.abs(total).max():
                return False
            u = mi.Vector3f(stratified(SIDE, 1, 0))
            for n in numbers:
                context = self.context(n, mi.TransportMode.Importance)
                bs, weight = self.bsdf.sample(context, interaction(mi.Vector3f(0.6, 0, 0.8) + 0 * u), u.z, u.xy)
                sampled = np.asarray(bs.sampled_type) & KINDS
                lit = (channels(weight).max(axis=0) > 0) & (np.asarray(bs.pdf) > 0)
                own = int(self.bsdf.flags(self.components[n])) & KINDS  # type: ignore[arg-type]
                if np.any(lit & ((sampled & own) == 0)):
                    return False
        except RuntimeError:  # a BSDF may refuse to be asked for one
            return False
        return True


#: The bits that say what a lobe does, without the sides it is on.
KINDS = 0x1FF


def part_of(number: int, flags: list[int]) -> Part:
    """What components with these flags do together."""
    bits = 0
    for flag in flags:
        bits |= flag

    def has(kind: Any) -> bool:
        return bool(bits & int(kind))

    f = mi.BSDFFlags
    smooth, ideal, glossy = has(f.Smooth), has(f.Delta) or has(f.Null), has(f.Glossy)
    words = [word for word, on in (("diffuse", has(f.Diffuse)), ("glossy", glossy), ("ideal", ideal)) if on]
    transmits = has(f.Transmission) or has(f.Null)
    words += ["transmission"] if transmits else []
    return Part(f"{number} {' '.join(words)}", smooth, ideal, glossy, has(f.Reflection), transmits)


def sided(flag: int) -> bool:
    """Whether a component says which side it is on."""
    return bool(flag & int(mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide))


def can_be_below(bsdf: mi.BSDF) -> bool:
    """Whether light passes through, so that it is to be asked from below as well."""
    return mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission) or mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)


def differentiable(params: mi.SceneParameters) -> list[str]:
    """The keys of the parameters in which one may differentiate: numbers that Mitsuba does not say may not."""
    found = []
    for key in params.keys():  # noqa: SIM118  (mi.SceneParameters is no dictionary)
        try:
            value = params[key]
        except TypeError:  # one that is not set
            continue
        fixed = int(params.flags(key)) & int(mi.ParamFlags.NonDifferentiable)
        if not fixed and dr.is_diff_v(value) and dr.is_float_v(value) and not dr.is_matrix_v(value):
            found.append(key)
    return found


def interaction(wi: mi.Vector3f) -> mi.SurfaceInteraction3f:
    """A hit seen from `wi`, at the middle of the texture."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wi))
    si.wi = wi
    si.uv = mi.Point2f(0.5)
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    if mi.is_spectral:
        si.wavelengths = mi.Spectrum(*WAVELENGTHS)
    return si


def plain_settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """What of a dictionary for ``mi.load_dict`` are numbers, colours and text."""
    out = {}
    for key, value in given.items():
        if key == "type":
            continue
        if isinstance(value, Mapping) and value.get("type") == "rgb":
            value = tuple(float(c) for c in np.broadcast_to(value["value"], 3))
        if isinstance(value, str | bool | int | float | tuple | list):
            out[key] = value
    return out


def from_dict(given: Mapping[str, Any]) -> BsdfSubject:
    """A BSDF from a dictionary as for ``mi.load_dict``."""
    settings = plain_settings(given)
    whole = len(settings) == len(given) - 1
    line = shell_line(str(given["type"]), settings) if whole else ""
    return BsdfSubject(mi.load_dict(dict(given)), str(given["type"]), settings if whole else {"bsdf": given}, line)
