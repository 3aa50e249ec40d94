"""Smooth surfaces and what lies under them, as books print it, in 60 digits; shares no code with brdf."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
from mpmath import mp, mpf

mp.dps = 60

Vector = Sequence[Any]


def fresnel_conductor(c: Any, eta: Any, k: Any) -> Any:
    """Snell's law and the two amplitudes, in complex numbers."""
    n = mpmath.mpc(eta, k)
    cos_t = mpmath.sqrt(1 - (1 - c**2) / n**2)
    s = (c - n * cos_t) / (c + n * cos_t)
    p = (n * c - cos_t) / (n * c + cos_t)
    return (abs(s) ** 2 + abs(p) ** 2) / 2


def refracted(w: Vector, eta: Any) -> list[Any]:
    """Snell's law by angles: the direction behind the surface, `eta` the index there over that on the side of `w`."""
    s2 = w[0] ** 2 + w[1] ** 2
    sin_t = mpmath.sqrt(s2) / eta
    angle = mpmath.asin(sin_t)
    scale = mpmath.sin(angle) / mpmath.sqrt(s2) if s2 else mpf(0)
    return [-w[0] * scale, -w[1] * scale, -mpmath.sign(w[2]) * mpmath.cos(angle)]


def mean(reflectance: Callable[[Any, Any], Any], eta: Any) -> Any:
    """``2 integral of F c dc`` by quadrature, in 30 digits: split at the critical angle, if there is one."""
    with mpmath.workdps(30):
        critical = mpmath.sqrt(1 - eta**2) if eta < 1 else mpf(0)
        points = [critical + (1 - critical) * mpf(x) for x in ("0", "0.001", "0.03", "0.3", "1")]
        return critical**2 + mpmath.quad(lambda c: 2 * c * reflectance(c, eta), points)


def fresnel_mean_closed(n: Any) -> Any:
    """Walsh's closed form of the mean reflectance from outside, n > 1, as Egan and Hilgeman (1979) print it."""
    below = (n**2 + 1) * (n**4 - 1)
    return (
        mpf(1) / 2
        + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
        + n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * mpmath.log((n - 1) / (n + 1))
        - 2 * n**3 * (n**2 + 2 * n - 1) / below
        + 8 * n**4 * (n**4 + 1) / (below * (n**4 - 1)) * mpmath.log(n)
    )


def glazed(i: Any, o: Any, eta: Any, diffuse: Any, law: Callable[[Any, Any], Any], outside: Any) -> Any:
    """The base of a coated diffuser at cosines `i` and `o`, with the mean of `law` outside: what goes in, is reflected by
    the base any number of times (a geometric series), and goes out, as radiance thinned by ``eta^2``."""
    inside = 1 - (1 - outside) / eta**2
    series = diffuse / (1 - diffuse * inside)
    return (1 - law(i, eta)) * series / mpmath.pi * (1 - law(o, eta)) / eta**2


def dipole_reflectance(sigma_s: Any, sigma_a: Any, g: Any, eta: Any, inside: Any) -> Any:
    """Total reflectance of Jensen's dipole, with depths: ``a'/2 (exp(-sigma_tr z_r) + exp(-sigma_tr z_v))``."""
    reduced = sigma_s * (1 - g)
    total = reduced + sigma_a
    transport = mpmath.sqrt(3 * sigma_a * total)
    A = (1 + inside) / (1 - inside)
    z_r = 1 / total
    z_v = z_r * (1 + 4 * A / 3)
    return reduced / total / 2 * (mpmath.exp(-transport * z_r) + mpmath.exp(-transport * z_v))
