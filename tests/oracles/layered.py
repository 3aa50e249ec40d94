"""Smooth surfaces, layers and grooves as functions of float32 numbers: see `tests.oracles.exact`.

Of a direction next to a smooth surface only the cosine ``w.z`` counts, and its sign: ``sin^2 = 1 - w.z^2``. A refracted
direction has ``(w.x, w.y) / eta`` across the normal, its cosine along it, and is then brought to unit length. Hanrahan and
Krueger's layer takes directions by their angles: they are brought to unit length first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
from mpmath import mpf

from tests.oracles import bricks, layer, optics, row, textbook
from tests.oracles.bricks import Answer


def far_index(z: Any, eta: Any) -> Any:
    return eta if z > 0 else 1 / eta


def critical(z: Any, eta: Any) -> Any:
    """Relative distance from the critical angle on the side of `z`."""
    return bricks.critical(z**2, 1 - z**2, far_index(z, eta))


def glass_reflectance(z: Any, eta: Any) -> Any:
    return textbook.fresnel_dielectric(abs(z), far_index(z, eta))


def glass_direction(x: Any, y: Any, z: Any, eta: Any) -> tuple[Any, Any]:
    """Along the normal and across it; under total internal reflection straight on, which means nothing."""
    n = far_index(z, eta)
    sin2 = (1 - z**2) / n**2
    if sin2 >= 1:
        return -z, mpmath.hypot(x, y)
    cos, across = mpmath.sqrt(1 - sin2), mpmath.hypot(x, y) / n
    length = mpmath.hypot(cos, across)
    return -mpmath.sign(z) * cos / length, across / length


def glazed_law(model: Any) -> tuple[Callable[..., Any], Callable[[Any], Any]]:
    """F by cosine and index, and its mean from outside."""

    def normal(eta: Any) -> Any:
        return ((eta - 1) / (eta + 1)) ** 2

    match model.fresnel:
        case "exact":
            return textbook.fresnel_dielectric, optics.fresnel_mean_closed
        case "schlick":
            return textbook.fresnel_schlick, lambda eta: normal(eta) + (1 - normal(eta)) / 21
        case _:
            return lambda c, eta: normal(eta), normal


def glazed(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    law, mean = glazed_law(model)
    return optics.glazed(wi[2], wo[2], p.eta, p.diffuse_reflectance, law, mean(p.eta))


def glazed_mirror(choice: str) -> Answer:
    from brdf.models.glazed import Glazed  # names the choices, no more

    law, _ = glazed_law(Glazed(fresnel=choice))
    return Answer(lambda x, y, z, eta, kd, ks: ks * law(z, eta))


def dipole(sigma_s: Any, sigma_a: Any, g: Any, eta: Any) -> Any:
    inside = 1 - (1 - optics.fresnel_mean_closed(eta)) / eta**2
    return optics.dipole_reflectance(sigma_s, sigma_a, g, eta, inside)


def diffusion(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    rd = dipole(p.sigma_s, p.sigma_a, p.g, p.eta)
    ti, to = (1 - textbook.fresnel_dielectric(w[2], p.eta) for w in (wi, wo))
    return ti * to * rd / mpmath.pi


def diffusion_peak(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """Without the exponentials, and without T."""
    return 1 / (1 + p.sigma_a / (p.sigma_s * (1 - p.g)))


def hanrahankrueger(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    return layer.scattered(wi, wo, p.sigma_s, p.sigma_a, p.thickness, p.g, p.eta)


def hanrahankrueger_peak(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """What has not been absorbed on its way."""
    return layer.scattered(wi, wo, p.sigma_s, mpf(0), mpf(2) ** -100, p.g, p.eta) * p.thickness * mpf(2) ** 100


def unscattered(x: Any, y: Any, z: Any, sigma_s: Any, sigma_a: Any, thickness: Any, g: Any, eta: Any) -> Any:
    return layer.unscattered((x, y, z), sigma_s, sigma_a, thickness, eta)


def grooved(model: Any, wi: Any, wo: Any, p: Any) -> Any:
    """The part that `p` has the reflectance of."""
    if hasattr(p, "reflectance"):
        return p.reflectance * row.of_row(lambda i, o, d, h, n: row.diffuse(i, o, row.Row(i, o, d, h), d))(
            model, wi, wo, p
        )
    return p.specular_reflectance * grooved_phong(model, wi, wo, p)


grooved_phong = row.of_row(lambda i, o, d, h, n: row.phong(i, o, row.Row(i, o, d, h), d, n))
#: As much as the lobe is at its maximum everywhere.
grooved_peak = row.of_row(lambda i, o, d, h, n: row.diffuse(i, o, row.Row(i, o, d, h), d) * (n + 2))
grooved_kink = row.of_row(lambda i, o, d, h, n: row.Row(i, o, d, h).kink)


ANSWERS = {
    "grooved": Answer(grooved, grooved_peak, grooved_kink),
    "glazed": Answer(glazed),
    "diffusion": Answer(diffusion, diffusion_peak),
    "hanrahankrueger": Answer(hanrahankrueger, hanrahankrueger_peak),
}
BY_NAME = {
    "mirror, reflected": Answer(lambda x, y, z, ks: ks),
    "metal, reflected": Answer(
        lambda x, y, z, eta, k, ks: ks * bricks.fresnel_conductor(z, eta, k),
        kink=lambda x, y, z, eta, k, ks: bricks.critical(z**2, 1 - z**2, eta, k),
    ),
    "glass, reflected": Answer(
        lambda x, y, z, eta, ks, kt: ks * glass_reflectance(z, eta), kink=lambda x, y, z, eta, ks, kt: critical(z, eta)
    ),
    "glass, refracted": Answer(
        lambda x, y, z, eta, ks, kt: kt * (1 - glass_reflectance(z, eta)),
        kink=lambda x, y, z, eta, ks, kt: critical(z, eta),
    ),
    "glass, refracted cosine": Answer(
        lambda x, y, z, eta, ks, kt: glass_direction(x, y, z, eta)[0],
        kink=lambda x, y, z, eta, ks, kt: critical(z, eta),
    ),
    "glass, refracted sine": Answer(
        lambda x, y, z, eta, ks, kt: glass_direction(x, y, z, eta)[1],
        kink=lambda x, y, z, eta, ks, kt: critical(z, eta),
    ),
    "diffusion, dipole": Answer(dipole),
    "glazed, mirror": glazed_mirror("exact"),
    "glazed, schlick mirror": glazed_mirror("schlick"),
    "glazed, constant mirror": glazed_mirror("constant"),
    "hanrahankrueger, unscattered": Answer(
        unscattered, lambda x, y, z, s, a, thickness, g, eta: layer.through((x, y, z), eta) ** 2
    ),
}
