"""What may be fitted of Mitsuba's own BSDFs, and how their XML says it.

The names are those of ``mi.traverse``. A test compares the forward-mode derivative of ``eval`` in each with
differences: they agree to float32. That of ``roughdielectric`` in ``eta`` does so seen from outside; from inside, the
reflectance has a kink at the critical angle. Left out: ``principled``'s sampling rates, which do not change how it
looks.

``principled`` switches a lobe off while its weight is 0 and then gives no gradient: start from more than 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mitsuba as mi
import numpy as np

from brdf import Param
from brdf.param import colour, number

from . import indices
from .registry import registered

#: Mitsuba's microfacet code takes no smaller alpha.
SMALLEST_ALPHA = 1e-4
#: ``principled`` has alpha = roughness**2 and takes no alpha below 1e-3.
SMALLEST_ROUGHNESS = 1e-3**0.5
#: ``principled`` replaces eta = 1 by this, and specular = 0 by 1e-3.
SMALLEST_ETA, SMALLEST_SPECULAR = 1.001, 1e-3

Value = float | tuple[float, float, float]


def alpha(name: str, which: str = "") -> Param:
    """A microfacet roughness of Mitsuba's."""
    meaning = f"roughness{which}: rms slope of the facets (Beckmann), or GGX's alpha"
    hint = "An artist's roughness r is alpha = r**2."
    return number(name, 0.1, (SMALLEST_ALPHA, 1.5), meaning, scale="log", hint=hint)


def weight(name: str, meaning: str, default: float = 0.0) -> Param:
    """A parameter of ``principled`` between 0 and 1."""
    return number(name, default, (0.0, 1.0), meaning, scale="logit")


ALPHAS = (alpha("alpha"), alpha("alpha_u", " along dp/du"), alpha("alpha_v", " along dp/dv"))
SPECULAR = colour("specular_reflectance", 1.0, "factor on the specular reflection; 1 is physical")

TABLE: dict[str, tuple[Param, ...]] = {
    "diffuse": (colour("reflectance", 0.5, "albedo"),),
    "roughconductor": (
        *ALPHAS,
        colour("eta", 0.0, "real part of the index of refraction", bounds=(1e-3, 20.0), scale="log"),
        colour("k", 1.0, "imaginary part of the index of refraction", bounds=(1e-3, 20.0), scale="log"),
        SPECULAR,
    ),
    "roughdielectric": (
        *ALPHAS,
        number("eta", 1.5046, (1 + 2.0**-20, 10.0), "index of refraction, inside over outside", scale="log_minus_one"),
        SPECULAR,
        colour("specular_transmittance", 1.0, "factor on the transmission; 1 is physical"),
    ),
    "principled": (
        colour("base_color", 0.5, "colour of the material"),
        number("roughness", 0.5, (SMALLEST_ROUGHNESS, 1.0), "artist's roughness: alpha is its square", scale="log"),
        number("eta", 1.5, (SMALLEST_ETA, 10.0), "index of refraction, if the XML gives it", scale="log_minus_one"),
        number("specular", 0.5, (SMALLEST_SPECULAR, 1.0), "index of refraction, scaled to 0..1, unless eta is given"),
        weight("metallic", "from dielectric to metal"),
        weight("anisotropic", "from round to stretched highlights"),
        weight("spec_trans", "from reflection to transmission"),
        weight("spec_tint", "tint of the dielectric reflection"),
        weight("sheen", "sheen at grazing angles"),
        weight("sheen_tint", "tint of the sheen"),
        weight("flatness", "from diffuse to flat subsurface-like reflection"),
        weight("clearcoat", "strength of the clear coat"),
        weight("clearcoat_gloss", "gloss of the clear coat"),
    ),
}


def tell_colours_apart(props: mi.Properties) -> None:
    """Make every constant colour of a BSDF three numbers, in the RGB variants: a fit moves each on its own.

    A colour left out is filled in with its default, for Mitsuba's own BSDFs; ours do that themselves.
    """
    if not mi.is_rgb:
        return
    plugin = props.plugin_name()
    model = registered().get(plugin)
    for p in model.params if model else TABLE.get(plugin, ()):
        if p.kind != "colour" or (p.name not in props and (model or preset(plugin, props, p.name))):
            continue
        kind = props.type(p.name).name if p.name in props else "absent"
        value: Any = p.default[0] if kind == "absent" else props[p.name]
        if kind == "Spectrum":
            value = value.values[0] if value.is_uniform() else None
        if kind in ("absent", "Float", "Integer", "Spectrum") and value is not None:
            props[p.name] = mi.ScalarColor3d(float(value))


def preset(plugin: str, props: mi.Properties, name: str) -> bool:
    """Whether a parameter follows from ``material="Al"``."""
    metal = plugin == "roughconductor" or (
        plugin in registered() and indices.MATERIAL in indices.accepted(registered()[plugin])
    )
    return metal and name in ("eta", "k") and "material" in props and props["material"] != "none"


def as_xml(plugin: str, props: mi.Properties, values: Mapping[str, Value]) -> tuple[dict[str, Value | str], list[str]]:
    """How a BSDF's XML says these values: what to set, and what to remove because it would contradict.

    Parameters
    ----------
    props : mi.Properties
        What the XML says now.
    values : by the names of ``mi.traverse``

    Returns
    -------
    (dict, list of str)
        By the names of the XML; a str is the name of a file with a spectrum.
    """
    out: dict[str, Value | str] = dict(values)
    if "eta" in out and any(name in props for name in indices.MEDIA) and plugin in registered():
        return out, [name for name in indices.MEDIA if name in props]
    if plugin == "roughdielectric" and "eta" in out:
        outside = indices.index(plugin, "ext_ior", props["ext_ior"] if "ext_ior" in props else "air")
        out["int_ior"] = float(out.pop("eta")) * outside  # type: ignore[arg-type]
    if any(preset(plugin, props, name) for name in values):
        metal = mi.load_dict({"type": "roughconductor", "material": props["material"]})
        params = mi.traverse(metal)
        for name in ("eta", "k"):
            if name not in out and f"{name}.value" in params:
                components = [float(c) for c in np.asarray(params[f"{name}.value"]).ravel()]
                out[name] = tuple(components) if len(components) == 3 else components[0]  # type: ignore[assignment]
            elif name not in out:  # spectral: the table the preset stands for
                out[name] = f"data/ior/{props['material']}.{name}.spd"
        return out, ["material"]
    return out, []
