"""Single scattering in a layer: as an integral over depth, and as Hanrahan and Krueger print it, in 60 digits; shares no
code with brdf."""

from __future__ import annotations

from typing import Any

import mpmath
from mpmath import mp, mpf

from tests.oracles import textbook

mp.dps = 60

Vector = Any


def inner(w: Vector, eta: Any) -> list[Any]:
    """Where light to `w` outside comes from inside: the same plane, the same side, Snell's angle."""
    x, y, z = (mpf(c) for c in w)
    across = mpmath.hypot(x, y)
    theta = mpmath.asin(mpmath.sin(mpmath.atan2(across, abs(z))) / eta)
    scale = mpmath.sin(theta) / across if across else mpf(0)
    return [x * scale, y * scale, mpmath.sign(z) * mpmath.cos(theta)]


def phase(i: Vector, o: Vector, g: Any) -> Any:
    """Henyey and Greenstein's, of light that comes along -i and leaves along o."""
    cos = -mpmath.fsum(a * b for a, b in zip(i, o, strict=True))
    return (1 - g**2) / (4 * mpmath.pi * (1 + g**2 - 2 * g * cos) ** mpf("1.5"))


def through(w: Vector, eta: Any) -> Any:
    """Transmittance of a side for light from `w`."""
    x, y, z = (mpf(c) for c in w)
    return 1 - textbook.fresnel_dielectric(mpmath.cos(mpmath.atan2(mpmath.hypot(x, y), abs(z))), eta)


def scattered_over_depth(wi: Vector, wo: Vector, sigma_s: Any, sigma_a: Any, thickness: Any, g: Any, eta: Any) -> Any:
    """The BSDF by adding up depths: light that arrives at depth z along `wi`, is scattered there, and leaves along `wo`, up
    or down. In 20 digits."""
    i, o = inner(wi, eta), inner(wo, eta)
    mi, mo, sigma_t = abs(i[2]), abs(o[2]), sigma_s + sigma_a
    same_side = i[2] * o[2] > 0

    def at(z: Any) -> Any:
        out = z if same_side else thickness - z
        return mpmath.exp(-sigma_t * z / mi) * sigma_s / mi * mpmath.exp(-sigma_t * out / mo) / mo

    with mpmath.workdps(20):
        ends = [thickness * mpf(x) for x in ("0", "0.01", "0.1", "0.5", "0.9", "0.99", "1")]
        depth = mpmath.quad(at, ends)
    return through(wi, eta) * through(wo, eta) / eta**2 * phase(i, o, g) * depth


def scattered(wi: Vector, wo: Vector, sigma_s: Any, sigma_a: Any, thickness: Any, g: Any, eta: Any) -> Any:
    """The BSDF in closed form, with the limits where it is 0/0."""
    i, o = inner(wi, eta), inner(wo, eta)
    mi, mo, sigma_t = abs(i[2]), abs(o[2]), sigma_s + sigma_a
    tau = sigma_t * thickness
    if not sigma_t:
        depth = sigma_s * thickness / (mi * mo)
    elif i[2] * o[2] > 0:
        depth = sigma_s / sigma_t / (mi + mo) * -mpmath.expm1(-tau * (1 / mi + 1 / mo))
    elif abs(mi - mo) < mpf(10) ** -40:
        depth = sigma_s * thickness / mi**2 * mpmath.exp(-tau / mi)
    else:
        depth = sigma_s / sigma_t / (mi - mo) * mpmath.exp(-tau / mi) * -mpmath.expm1(tau * (1 / mi - 1 / mo))
    return through(wi, eta) * through(wo, eta) / eta**2 * phase(i, o, g) * depth


def unscattered(wi: Vector, sigma_s: Any, sigma_a: Any, thickness: Any, eta: Any) -> Any:
    """The fraction of the light that passes both sides and the layer straight on."""
    return through(wi, eta) ** 2 * mpmath.exp(-(sigma_s + sigma_a) * thickness / abs(inner(wi, eta)[2]))
