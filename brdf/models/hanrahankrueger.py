"""Hanrahan and Krueger's layer: what is scattered once in it, up and down, and what passes it."""

from __future__ import annotations

from typing import Any

import drjit as dr

from .. import fresnel, geometry
from ..model import Ideal, Lobe, Model, Values
from ..param import colour, number
from ..stable import decay, mean_decay

#: Up to this optical depth scattering comes from a series in the depth; beyond, differences of exponentials are good.
THIN = 0.5


class HanrahanKrueger(Model):
    """A sheet of scattering material with smooth sides, in air: single scattering by Henyey and Greenstein's phase.

    ``f = T_i T_o / eta^2 f_inner``: T is the Fresnel transmittance of a side, and `f_inner` is of the refracted
    directions, whose cosines are ``m_i`` and ``m_o``. With ``sigma_t = sigma_s + sigma_a``, ``tau = sigma_t thickness``
    and the phase `p`, whose integral over the sphere is 1::

        reflected    sigma_s/sigma_t p (1 - exp(-tau (1/m_i + 1/m_o))) / (m_i + m_o)
        transmitted  sigma_s/sigma_t p (exp(-tau/m_i) - exp(-tau/m_o)) / (m_i - m_o)
        unscattered  T_i^2 exp(-tau/m_i), straight on

    Not in it are: what the outer side mirrors; light that goes to and fro between the sides, so that clear material
    passes ``T_i^2``; and what is scattered more than once, so that a bright, thick layer is darker than in nature
    (isotropic, without sides and absorption, a deep one reflects .15 of the light at the normal, .5 at grazing). All
    lobes together thus send out no more than arrives. Both sides of the layer are alike, and it is seen from both. From
    ``tau = 88`` on it is infinitely thick in float32; the largest `thickness` makes any but the clearest material so.

    The scattered lobes are called diffuse, since reflection has no highlight, whatever `g`. The peak of width 1 - g
    about the straight direction (for g < 0 about `wi`) is sampled as one, at grazing also where it reaches over to the
    other side; the rest by the cosine. Both lobes are reciprocal bit for bit: built from sums, products, the larger and
    the smaller of two.

    A picture depends on ``sigma_s thickness`` and ``sigma_a thickness`` alone: fix the thickness and fit the other two.
    Of an infinite layer it depends on ``sigma_s / sigma_a``; of a thin one on ``sigma_s thickness``, and sigma_a hardly
    shows. In reflection alone `g` and `eta` are nearly confounded with sigma_s: their derivatives correlate by .96 and
    more. Transmitted light tells them apart.

    References
    ----------
    hanrahan1993; henyey1941 (the phase).
    """

    name = "hanrahankrueger"
    summary = "leaves, paper, skin, dust: light scattered once in a layer, reflected and transmitted"
    source = ("hanrahan1993", "henyey1941")
    params = (
        colour("sigma_s", 1.0, "scattering coefficient", bounds=(0.0, 1e4), scale="log", unit="1/mm"),
        colour("sigma_a", 0.1, "absorption coefficient", bounds=(0.0, 1e4), scale="log", unit="1/mm"),
        number("thickness", 1.0, (0.0, 1e6), "of the layer; 1e6 is infinitely thick", scale="log", unit="mm"),
        number(
            "g",
            0.0,
            (-0.95, 0.95),
            "mean cosine of one scattering event: > 0 forward, < 0 back",
            scale="logit",
            hint="What goes on within a few degrees is as good as not scattered: lower sigma_s by it.",
        ),
        number(
            "eta",
            1.5,
            (1.0, 10.0),
            "index of refraction, inside over outside; 1 is a layer without sides",
            scale="log_minus_one",
            hint="eta is inside over outside; a layer seen from air has eta >= 1.",
        ),
    )
    lobes = (Lobe.DIFFUSE, Lobe.DIFFUSE_TRANSMISSION, Lobe.STRAIGHT)
    trials = (
        {},
        {"sigma_a": 0.0, "thickness": 1e6, "eta": 1.1},
        {"sigma_s": 20.0, "sigma_a": 0.0, "g": 0.8, "thickness": 0.1, "eta": 1.3},
        {"thickness": 0.01, "g": -0.8, "eta": 1.1},
    )

    def faults(self) -> dict[str, str]:
        return {
            "gradient_prb": "prb takes derivatives from eval: where straight light was sampled it finds the scattered's"
        }

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        wi, wo = geometry.unit(wi), geometry.unit(wo)  # a sharp phase and grazing light both need the length to be 1
        i, o = inside(wi, p.eta), inside(wo, p.eta)
        mi, mo = abs(i.z), abs(o.z)
        # each by its own eta: the square of a large one underflows in its derivative
        sides = (crossed(wi, p.eta) / p.eta) * (crossed(wo, p.eta) / p.eta)
        once = sides * henyey_greenstein(i, o, p.g)
        return once * reflected(p, mi, mo), once * transmitted(p, mi, mo), 0.0

    def ideal(self, p: Values, wi: Any, lobe: int) -> Ideal:
        return Ideal(-wi, unscattered(p, geometry.unit(wi)))

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        axis, g, share, side = self.around(p, wi, lobe)
        w = geometry.cosine_hemisphere(u, wi)
        h = geometry.about(axis, henyey_greenstein_sample(u, g, wi))
        h = type(wi)(h.x, h.y, abs(h.z))
        w = dr.select(u.z < share, h, w)
        return type(wi)(w.x, w.y, dr.mulsign(w.z, side))

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        return self.density(p, wi, wo, 0), self.density(p, wi, wo, 1), 0.0

    def density(self, p: Values, wi: Any, wo: Any, lobe: int) -> Any:
        axis, g, share, _ = self.around(p, wi, lobe)
        z = abs(wo.z)
        up, down = type(wi)(wo.x, wo.y, z), type(wi)(wo.x, wo.y, -z)
        both = henyey_greenstein(-axis, up, g) + henyey_greenstein(-axis, down, g)
        return (1 - share) * z * dr.inv_pi + share * both

    def around(self, p: Values, wi: Any, lobe: int) -> tuple[Any, Any, Any, Any]:
        """Axis and `g` of a lobe's peak as seen from outside, turned upwards; its share of the samples; where up is.

        Refracted outwards a peak is wider by `eta`: its `g` there has ``(1 - g)^2 / g`` larger by ``eta^2``. A peak on
        the other side reaches over to this one if it grazes, inside, by about its width 1 - g.
        """
        sign = 1.0 if lobe == 0 else -1.0
        forward = dr.select(p.g > 0, -1.0, 1.0)
        g = abs(p.g)
        width = p.eta * (1 - g)
        outside = 4 * g / dr.square(width + dr.sqrt(width * width + 4 * g))
        here = sign * p.g < 0
        c = abs(inside(wi, p.eta).z)
        least = dr.square(1 - g)
        reach = least / (least + g * c * c)
        share = outside * dr.select(here, 1, reach)
        return type(wi)(forward * wi.x, forward * wi.y, abs(wi.z)), outside, share, sign * wi.z

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any, Any]:
        m = abs(inside(wi, p.eta).z)
        enters = 0.25 * crossed(wi, p.eta) / (p.eta * p.eta)
        up, down = dr.mean(reflected(p, m, 1.0)), dr.mean(transmitted(p, m, 1.0))
        return enters * (1 - p.g) * up, enters * (1 + p.g) * down, dr.mean(unscattered(p, wi))


def inside(w: Any, eta: Any) -> Any:
    """The direction inside the layer that belongs to `w`, turned about. Only pairs of them matter."""
    return geometry.refract(w, eta)[0]


def crossed(w: Any, eta: Any) -> Any:
    """The fraction of the light from `w` that enters through a side, or of that inside which leaves to `w`."""
    return fresnel.transmittance_dielectric(abs(w.z), geometry.sine2(w), eta)


def unscattered(p: Values, wi: Any) -> Any:
    """The fraction of the light from `wi` that goes straight through."""
    t = crossed(wi, p.eta)
    return t * t * decay((p.sigma_s + p.sigma_a) * (p.thickness / abs(inside(wi, p.eta).z)))


def reflected(p: Values, mi: Any, mo: Any) -> Any:
    """``sigma_s/sigma_t (1 - exp(-tau (1/mi + 1/mo))) / (mi + mo)`` [1], also for ``sigma_t = 0``."""
    sigma_t = p.sigma_s + p.sigma_a
    path = p.thickness * (1 / mi + 1 / mo)
    depth = sigma_t * path
    thin = depth < THIN
    little = dr.select(thin, p.sigma_s * path, 0) * mean_decay(dr.select(thin, depth, 0))
    much = p.sigma_s / dr.select(thin, 1, sigma_t) * (1 - decay(depth))
    return dr.select(thin, little, much) / (mi + mo)


def transmitted(p: Values, mi: Any, mo: Any) -> Any:
    """``sigma_s/sigma_t (exp(-tau/mi) - exp(-tau/mo)) / (mi - mo)`` [1], also for ``mi = mo`` and ``sigma_t = 0``."""
    sigma_t = p.sigma_s + p.sigma_a
    steep, flat = dr.maximum(mi, mo), dr.minimum(mi, mo)
    apart = steep - flat
    path = p.thickness / steep
    passed = decay(sigma_t * path)
    detour = sigma_t * (p.thickness * (apart / steep / flat))
    thin = detour < THIN
    little = p.sigma_s * (path / flat) * passed * mean_decay(dr.select(thin, detour, 0))
    lost = passed - decay(sigma_t * (p.thickness / flat))
    much = p.sigma_s * lost / dr.select(thin, 1, sigma_t * apart)
    return dr.select(thin, little, much)


def henyey_greenstein(i: Any, o: Any, g: Any) -> Any:
    """The density [1/sr] of scattering between two unit vectors that point away from where it happens.

    ``(1 - g^2) / (4 pi d^(3/2))`` with ``d = 1 + g^2 + 2 g i.o``, since ``-i.o`` is the cosine of the deflection; as
    ``(1 - g)^2 + g |i + o|^2`` or ``(1 + g)^2 - g |i - o|^2``, whichever has no difference.

    References
    ----------
    henyey1941.
    """
    forth = (1 - g) * (1 - g) + g * geometry.square(i + o)
    back = (1 + g) * (1 + g) - g * geometry.square(i - o)
    d = dr.select(g > 0, forth, back)
    return (1 - g) * (1 + g) / (4 * dr.pi * d * dr.sqrt(d))


def henyey_greenstein_sample(u: Any, g: Any, like: Any) -> Any:
    """A unit vector about (0, 0, 1) with the density of `henyey_greenstein`, from `u` in [0, 1)^2; `g` >= 0.

    The square root of its `d` is ``(1 - g)(1 + g) / (1 + g - 2 g u)``; hence, without a difference, ``(d - (1 - g)^2)
    / g``, which is ``n = 2 (1 - cos)`` of the deflection.
    """
    rest = 1 + g - 2 * g * u.x
    root = (1 - g) * (1 + g) / rest
    n = (1 - g) * (2 * u.x / rest) * (root + 1 - g)
    s, c = dr.sincos(dr.two_pi * u.y)
    sin = 0.5 * dr.sqrt(n * dr.maximum(4 - n, 0))
    return type(like)(sin * c, sin * s, 1 - 0.5 * n)
