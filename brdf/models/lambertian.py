"""Ideal diffuse reflection: a surface equally bright from everywhere."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..model import Lobe, Model, Values
from ..param import colour


class Lambertian(Model):
    """``f = reflectance / pi``, sampled by the cosine."""

    name = "lambertian"
    summary = "ideal diffuse reflection"
    source = ("lambert1760",)
    params = (colour("reflectance", 0.5, "fraction of the light that is reflected, the directional albedo"),)
    lobes = (Lobe.DIFFUSE,)

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any]:
        return (p.reflectance * dr.inv_pi,)
