"""Minnaert's reflection: rough stone or powder, darker towards its edge than an ideal diffuser."""

import drjit as dr

from brdf import Model, colour, number


class Minnaert(Model):
    """``f = reflectance (exponent + 1) / (2 pi) (cos_i cos_o)^(exponent - 1)``."""

    name = "minnaert"
    summary = "diffuse reflection that darkens towards grazing: powder and rough stone"
    source = ("M. Minnaert, The reciprocity principle in lunar photometry, Astrophysical Journal 93 (1941) 403-410",)
    params = (
        colour("reflectance", 0.5, "albedo at normal incidence"),
        number("exponent", 1.5, (1.0, 10.0), "how fast it darkens; 1 is ideal diffuse reflection", scale="log"),
    )

    def f(self, p, wi, wo):
        return (p.reflectance * ((p.exponent + 1) / dr.two_pi * dr.power(wi.z * wo.z, p.exponent - 1)),)
