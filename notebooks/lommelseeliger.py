"""Lommel and Seeliger's reflection: light scattered once in a deep layer of dust."""

import drjit as dr

from brdf import Model, colour, number


class LommelSeeliger(Model):
    """``f = albedo p / (4 pi (cos_i + cos_o))``, with Henyey and Greenstein's phase function ``p``."""

    name = "lommelseeliger"
    summary = "dust that scatters light once: the Moon, whose full disk is as bright at its edge as in its middle"
    source = ("H. Seeliger 1888", "L. G. Henyey and J. L. Greenstein 1941")
    params = (
        colour("albedo", 0.3, "fraction of the light that a grain scatters"),
        number("g", -0.3, (-0.9, 0.9), "mean cosine of the scattering angle; negative: grains throw light back"),
    )

    def f(self, p, wi, wo):
        cosine = -dr.dot(wi, wo)  # of the scattering angle; wi and wo both point away from the surface
        phase = (1 - p.g * p.g) / (1 + p.g * p.g - 2 * p.g * cosine) ** 1.5
        return (p.albedo * (phase / (4 * dr.pi * (wi.z + wo.z))),)
