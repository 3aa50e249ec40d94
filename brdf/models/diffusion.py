"""Diffuse reflection from many scattering events below a smooth surface: the dipole as a BRDF."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import fresnel, geometry
from ..model import Lobe, Model, Values
from ..param import colour, number


class Diffusion(Model):
    """``f = T_i T_o R_d / pi``: T the Fresnel transmittance of the surface, R_d the total reflectance of the dipole.

    ``R_d = a'/2 exp(-s) (1 + exp(-4/3 A s))`` with ``s = sqrt(3 (1 - a'))`` and the reduced albedo ``a' = 1/(1 + q)``,
    ``q = sigma_a / (sigma_s (1 - g))``, so that ``1 - a' = q/(1 + q)`` is no difference. ``A = (1 + K)/(1 - K)`` is
    ``(2 eta^2 - t)/t``, where K is the mean Fresnel reflectance from inside and ``t = 1 - mean F`` from outside.

    This is how deep, flat, evenly lit material reflects: as much light comes up at a point from around it as leaves it.
    It depends on q alone: a picture does not tell the three coefficients of scattering apart, so fit one of them.
    What is scattered only once is not in it, nor what the surface itself reflects.

    References
    ----------
    jensen2001.
    """

    name = "diffusion"
    summary = "marble, milk, skin seen from afar: light scattered many times below a smooth surface"
    source = ("jensen2001",)
    params = (
        colour("sigma_s", (2.19, 2.62, 3.0), "scattering coefficient", bounds=(1e-3, 1e4), scale="log", unit="1/mm"),
        colour(
            "sigma_a", (0.0021, 0.0041, 0.0071), "absorption coefficient", bounds=(1e-6, 1e4), scale="log", unit="1/mm"
        ),
        number("g", 0.0, (-0.99, 0.99), "mean cosine of one scattering event"),
        number(
            "eta",
            1.5,
            (1 + 2.0**-20, 10.0),
            "index of refraction, inside over outside",
            scale="log_minus_one",
            hint="eta is inside over outside; a dielectric seen from air has eta > 1.",
        ),
    )
    lobes = (Lobe.DIFFUSE,)
    trials = ({}, {"sigma_a": 1e-6}, {"sigma_a": 1.0, "g": 0.9}, {"eta": 3.0})

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any]:
        ti, to = (fresnel.transmittance_dielectric(w.z, geometry.sine2(w), p.eta) for w in (wi, wo))
        return (total_reflectance(p) * (ti * to) * dr.inv_pi,)


def total_reflectance(p: Values) -> Any:
    """``R_d``: the fraction of even light inside that comes up to the surface again."""
    q = p.sigma_a / (p.sigma_s * (1 - p.g))
    s = dr.sqrt(3 * q / (1 + q))
    t = 1 - fresnel.fresnel_dielectric_mean(p.eta)
    A = (2 * p.eta * p.eta - t) / t
    return (0.5 / (1 + q)) * dr.exp(-s) * (1 + dr.exp((-4 / 3) * A * s))
