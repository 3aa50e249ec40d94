"""Poulin and Fournier's reflection of parallel cylindrical grooves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr

from .. import geometry
from ..model import Lobe, Model, Values
from ..param import colour, number
from ..quadrature import even_rule
from ..stable import EXPONENT_CAP, cube_remainder_of_sine, expm1, is_double, log1p, log_near_one, with_gradient

#: (float32, float64) The Phong lobe is integrated where it is above exp(-this) of its maximum: as much as rounding.
EFOLDS = (16.0, 36.0)
#: (float32, float64) Points of the rule. Most are needed by a lobe that has just fallen so far within a right angle.
POINTS = (22, 48)
#: (float32, float64) Below this exponent the lobe ends with a kink. There the points crowd towards both ends, by the
#: integral of ``(1 - x^2)^p`` in place of x, p = 1 or 3: a power n of the distance from the end becomes ``(p + 1) n``.
KINKED = (3.0, 6.0)
#: The floor stays below the tops: at 1 nothing is left of the cylinders, and the derivative in `height` is infinite.
HIGHEST = 0.999


RULES = tuple(even_rule(n, p) for n, p in zip(POINTS, (1, 3), strict=True))


class Grooved(Model):
    """A row of cylinders of radius 1 along y, `spacing` apart, whose axes lie `height` below a flat floor.

    ``f = 1/spacing integral of base(n') (n'.wi)/wi.z (n'.wo)/wo.z`` over what of one period is seen from `wi` and from
    `wo`, with ``base = reflectance / pi + specular_reflectance (exponent + 2) / (2 pi) max(cos a, 0)^exponent``, `a`
    the angle between `wo` and the mirror image of `wi` about the normal ``n'`` there. The Phong lobe is Lafortune and
    Willems': with (exponent + 2) it is reciprocal, and reflects at most `specular_reflectance`.

    Across the grooves, in the x-z plane, the arc of a cylinder and the stretch of floor that a direction reaches each
    have two ends in closed form (see `reach`), so what both directions reach is one arc and one stretch of floor. Over
    them the diffuse part is integrated in closed form, the Phong lobe by a rule. The ends move with
    `spacing` and `height`; derivatives take that into account by Leibniz's rule.

    Light is scattered once: what one groove throws onto another is lost, so energy is lost and never gained, as long as
    `reflectance` and `specular_reflectance` add up to 1 at most.

    Sampling follows a line of sight to a point of the period, reflects it there by the Phong lobe, and is lost if the
    way out is blocked. No sample weighs more than ``specular_reflectance (exponent + 2) / (exponent + 1)``.

    Notes
    -----
    Poulin and Fournier integrate the specular part by a Chebyshev approximation. They also have cylinders taken away
    from the surface, which are not here.

    References
    ----------
    poulin1990; lafortune1994.
    """

    name = "grooved"
    summary = "brushed or turned metal, cloth, records: parallel cylindrical grooves along the local y axis"
    source = ("poulin1990", "lafortune1994")
    params = (
        colour("reflectance", 0.3, "albedo of the diffuse part of cylinders and floor"),
        colour("specular_reflectance", 0.5, "tint of the Phong lobe of cylinders and floor"),
        number("exponent", 30.0, (1.0, 1e4), "Phong exponent of cylinders and floor", scale="log"),
        number(
            "spacing",
            2.5,
            (2.0, 20.0),
            "distance between the axes of neighbouring cylinders, in radii",
            scale="log",
            hint="Cylinders of radius 1 touch at spacing = 2.",
        ),
        number(
            "height",
            0.3,
            (0.0, HIGHEST),
            "height of the floor above the axes, in radii: 0 half cylinders, 1 no groove",
            scale="logit",
            hint="The floor lies between the axes, height = 0, and the tops of the cylinders.",
        ),
    )
    lobes = (Lobe.DIFFUSE, Lobe.GLOSSY)
    trials = (
        {},
        {"spacing": 2.0, "height": 0.0, "exponent": 1.0, "reflectance": 0.0, "specular_reflectance": 1.0},
        {"spacing": 4.0, "height": 0.9, "exponent": 200.0},
        {"spacing": 4.0, "height": 0.5, "reflectance": 1.0, "specular_reflectance": 1.0},
    )

    def faults(self) -> dict[str, str]:
        return {"coupling": "the diffuse and the glossy part of the cylinders are added: above 1 if both are white"}

    @property
    def anisotropic(self) -> bool:
        return True

    def f(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        still = Values(spacing=p.spacing, height=dr.detach(p.height))
        low, high, floor = in_common(still, reach(still, wi), reach(still, wo))
        phong = Phong(p.exponent, wi, wo)
        ti, to = wi.x / wi.z, wo.x / wo.z

        def facing(s: Any, c: Any) -> Any:
            """``(n'.wi)/wi.z (n'.wo)/wo.z`` where n' is (s, 0, c)."""
            return dr.maximum(c + s * ti, 0) * dr.maximum(c + s * to, 0)

        start, end = dr.detach(low), dr.detach(high)
        diffuse = moving_ends(diffuse_arc(end, wi, wo, 1) + diffuse_arc(-start, wi, wo, -1), facing, low, high)
        glossy = moving_ends(phong.arc(facing, start, end), lambda s, c: facing(s, c) * phong(s, c), low, high)
        rising = Rising(p.height, wi, wo, low, high, floor)
        diffuse = rising(floor + diffuse, lambda s, c: 1.0, 1.0)
        glossy = rising(floor * phong.floor + glossy, phong, phong.floor)
        scale = 1 / p.spacing
        diffuse = diffuse * scale * dr.inv_pi
        glossy = glossy * scale * ((p.exponent + 2) * dr.inv_two_pi)
        return p.reflectance * diffuse, p.specular_reflectance * glossy

    def sample(self, p: Values, wi: Any, u: Any, lobe: int) -> Any:
        if lobe == 0:
            return geometry.cosine_hemisphere(u, wi)
        vector = type(wi)
        i = reach(p, wi)
        angle, place = i.arc_as_seen(p, u.z), i.left + u.z * p.spacing
        on_floor = u.z < i.floor(p)
        s, c = dr.sincos(angle)
        m = vector(dr.select(on_floor, 0, s), 0, dr.select(on_floor, 1, c))
        # The lobe lies about `wi` first: a reflection brings the z axis there, and then one about `m`.
        log_cos = log1p(-u.x) / (p.exponent + 1)
        cos, sin = dr.exp(log_cos), dr.sqrt(-expm1(2 * log_cos))
        y, x = dr.sincos(dr.two_pi * u.y)
        about_wi = geometry.reflect_about(vector(sin * x, sin * y, cos), vector(wi.x, wi.y, wi.z + 1))
        wo = geometry.reflect_about(about_wi, m)
        # What cannot leave from there is lost.
        up = wo.z > 0
        o = reach(p, dr.select(up, wo, vector(0, 0, 1)))
        leaves = dr.select(
            on_floor, (place > o.left) & (place < p.spacing - o.right), (angle > o.low) & (angle < o.high)
        )
        return dr.select(up & leaves, wo, vector(0, 0, -1))

    def pdf(self, p: Values, wi: Any, wo: Any) -> tuple[Any, Any]:
        low, high, floor = in_common(p, reach(p, wi), reach(p, wo))
        phong = Phong(p.exponent, wi, wo)
        t = wi.x / wi.z
        arc = phong.arc(lambda s, c: dr.maximum(c + s * t, 0), low, high)
        return wo.z * dr.inv_pi, (floor * phong.floor + arc) / p.spacing * ((p.exponent + 1) * dr.inv_two_pi)

    def choose(self, p: Values, wi: Any) -> tuple[Any, Any]:
        return dr.mean(p.reflectance), dr.mean(p.specular_reflectance)


class Reach(NamedTuple):
    """What of one period a direction reaches, in the plane across the grooves.

    The arc of a cylinder is that between the angles `low` <= 0 and `high` >= 0 [rad], measured from z towards x. Of
    the floor, `left` and `right` of the axes of the cylinders at its two ends are covered or in shadow. `elevation` is
    the angle between the direction, projected into the plane, and the floor; `turn` is 1 if it leans towards +x, else
    -1.
    """

    low: Any
    high: Any
    left: Any
    right: Any
    elevation: Any
    turn: Any

    def floor(self, p: Values) -> Any:
        """The part of a period, as seen from the direction, that is floor."""
        return dr.maximum(p.spacing - self.left - self.right, 0) / p.spacing

    def arc_as_seen(self, p: Values, u: Any) -> Any:
        """The angle of the point of the arc that a line of sight meets, for uniform `u` in [floor, 1).

        Equal parts of the arc as seen are equal parts of ``1 - cos(angle from the terminator)``.
        """
        floor = self.floor(p)
        u = dr.maximum(u - floor, 0) / dr.select(floor < 1, 1 - floor, 1)
        back, front = (dr.select(self.turn > 0, a, b) for a, b in ((-self.low, self.high), (self.high, -self.low)))
        first, last = (dr.square(dr.sin(0.5 * a)) for a in (self.elevation - back, self.elevation + front))
        return self.turn * (2 * dr.asin(dr.sqrt(dr.lerp(first, last, u))) - self.elevation)


def in_common(p: Values, i: Reach, o: Reach) -> tuple[Any, Any, Any]:
    """What both reach: the arc's two ends [rad] and the length of the floor. It does not matter which comes first."""
    covered = dr.maximum(i.left, o.left) + dr.maximum(i.right, o.right)
    return dr.maximum(i.low, o.low), dr.minimum(i.high, o.high), dr.maximum(p.spacing - covered, 0)


def reach(p: Values, w: Any) -> Reach:
    """What of one period is reached from direction `w`.

    Mirrored so that `w` leans towards +x, with `e` its elevation in the plane across:

    - the arc ends at the floor, ``cos(angle) = height``;
    - behind, it ends at its terminator, ``angle = -e``;
    - in front, where the next cylinder's upper tangent comes down: ``angle = a - e``, ``1 - cos a = spacing sin e``
      (`a` is the angle from the terminator);
    - the floor ends at the foot of the cylinder behind, ``sqrt(1 - height^2)`` from its axis, and in front at that
      tangent, ``(1 - height cos e) / sin e`` from the axis, or at the foot if the tangent's point is below the floor.

    Parameters
    ----------
    w : 3-vector
        A direction, ``w.z > 0``.

    References
    ----------
    poulin1990.
    """
    turn = dr.select(w.x > 0, 1.0, -1.0)
    _, lean, sin = across(w)
    cos = abs(lean)
    elevation = 2 * dr.asin(sin * dr.rsqrt(2 + 2 * cos))  # the sine of half the angle
    foot2 = (1 - p.height) * (1 + p.height)
    foot = dr.sqrt(foot2)
    rim = rim_angle(p.height)
    back = dr.minimum(rim, elevation)
    # sin^2(a/2) and cos^2(a/2), whichever is smaller; beyond a = pi nothing stands in the way
    sin2, cos2 = 0.5 * p.spacing * sin, cos * cos / (1 + sin) - (0.5 * p.spacing - 1) * sin
    free = cos2 <= 0
    half = dr.asin(dr.sqrt(dr.select(free, 0.25, dr.minimum(sin2, cos2))))
    angle = dr.select(free, dr.pi, dr.select(sin2 < cos2, 2 * half, dr.pi - 2 * half))
    front = dr.minimum(rim, angle - elevation)
    # (1 - height cos) / sin without the difference
    tangent = (sin + foot2 * cos * (cos / sin)) / (1 + p.height * cos)
    hidden = dr.select(cos > p.height, dr.minimum(tangent, p.spacing), foot)
    forward = turn > 0
    return Reach(
        dr.select(forward, -back, -front),
        dr.select(forward, front, back),
        dr.select(forward, foot, hidden),
        dr.select(forward, hidden, foot),
        elevation,
        turn,
    )


def across(w: Any) -> tuple[Any, Any, Any]:
    """Length of a direction in the plane across the grooves, and its x and z there at unit length."""
    a = abs(w.x)
    far = dr.maximum(a, w.z)
    ratio = dr.minimum(a, w.z) / far
    length = far * dr.sqrt(1 + ratio * ratio)
    return length, w.x / length, w.z / length


def rim_angle(height: Any) -> Any:
    """Of the arc's end at the floor, ``acos(height)`` without its loss near 1."""
    return 2 * dr.asin(dr.sqrt(0.5 * (1 - height)))


class Rising:
    """The derivative in `height` of what floor and arc reflect: what the floor gains less what the arc loses.

    Leibniz's rule. On the side of x > 0, with ``foot = sqrt(1 - height^2)``, ``k = height / foot``, ``t = w.x / w.z``:

    - the floor's end, a foot or the edge of a shadow, recedes by ``max(k, -ti, -to)``, times the base there;
    - the arc, if it ends at the floor, loses ``(height + foot ti)(height + foot to) / foot``, times the base there.
      Then the floor ends at the foot.

    For a base of 1 the two leave ``foot (height / (1 + height) - ti to) - height (ti + to)``, in which neither 1 / foot
    is left; of two such ends the last terms cancel to the last bit. On the side of x < 0, t changes its sign.
    """

    def __init__(self, height: Any, wi: Any, wo: Any, low: Any, high: Any, floor: Any) -> None:
        self.height = height
        h = dr.detach(height)
        ti, to = (dr.detach(w.x / w.z) for w in (wi, wo))
        self.foot = dr.sqrt((1 - h) * (1 + h))
        self.steep = h / self.foot
        rim = rim_angle(h)
        self.right, self.left = (dr.select(end >= rim, 1.0, 0.0) for end in (dr.detach(high), -dr.detach(low)))
        ends = dr.select(self.right > 0, 0, dr.maximum(self.steep, dr.maximum(-ti, -to)))
        ends += dr.select(self.left > 0, 0, dr.maximum(self.steep, dr.maximum(ti, to)))
        self.ends = dr.select(floor > 0, ends, 0)
        self.even, self.odd = self.foot * (h / (1 + h) - ti * to), h * (ti + to)

    def __call__(self, integral: Any, base: Callable[[Any, Any], Any], on_floor: Any) -> Any:
        """`integral`, whose parts do not move with the height, with its derivative by it.

        Parameters
        ----------
        base : callable
            Of the normal (s, 0, c).
        on_floor : float
            ``base(0, 1)``.
        """
        h = dr.detach(self.height)
        right, left = (dr.select(e > 0, base(s, h), 0) for e, s in ((self.right, self.foot), (self.left, -self.foot)))
        # Of the two gains of 1 / foot, what the difference between the bases leaves.
        tilted = self.steep * (self.right * on_floor - right + (self.left * on_floor - left))
        slope = self.ends * on_floor + tilted + (right + left) * self.even - (right - left) * self.odd
        return with_gradient(integral, integral + dr.detach(slope) * self.height)


class Phong:
    """``max(cos a, 0)^exponent`` of a pair of directions, as a function of the normal (s, 0, c).

    About the bisector of the directions across, at angle `t` from it: ``cos a = 1 - v``, ``v |w|^2 = ((ri - ro)^2 +
    (yi + yo)^2) / 2 + 2 ri ro sin^2 t`` with `r` their lengths across. Towards a right angle, where ``1 - v`` would
    cancel, the cosine comes from products of components. It is symmetric in the directions bit for bit.
    """

    def __init__(self, exponent: Any, wi: Any, wo: Any) -> None:
        (ri, xi, zi), (ro, xo, zo) = across(wi), across(wo)
        along2, both = dr.square(wi.y + wo.y), 1 / (geometry.square(wi) + geometry.square(wo))
        self.double = is_double(ri)
        self.exponent = exponent
        self.least = (dr.square(ri - ro) + along2) * both
        self.swing = 4 * ri * ro * both
        # The bisector is along the sum of the two, and across their difference: whichever is longer does not cancel.
        opposed = abs(xi - xo) > zi + zo
        turn = dr.select(xi > xo, 1.0, -1.0)
        s, c = dr.select(opposed, turn * (zo - zi), xi + xo), dr.select(opposed, abs(xi - xo), zi + zo)
        length = dr.sqrt(s * s + c * c)
        self.s, self.c = s / length, c / length
        self.bisector = 2 * dr.asin(self.s * dr.rsqrt(2 + 2 * self.c))  # the sine of half the angle
        # ``R.wo = cos(2 t) (zi zo - xi xo) + sin(2 t) (xi zo + zi xo) - yi yo``, t the angle of the normal from z
        self.along, self.turned = 2 * both * (wi.z * wo.z - wi.x * wo.x), 2 * both * (wi.x * wo.z + wi.z * wo.x)
        self.aside = 2 * both * (wi.y * wo.y)
        #: On the floor: there v is the squared distance from the mirror image, without a detour by angles.
        self.floor = self.power(
            (dr.square(wi.x + wo.x) + along2 + dr.square(wi.z - wo.z)) * both, self.along - self.aside
        )

    def __call__(self, s: Any, c: Any) -> Any:
        return self.at(s * self.c - c * self.s, s, c)

    def at(self, sin: Any, s: Any, c: Any) -> Any:
        """The lobe of the normal (s, 0, c), whose angle from the bisector has this sine."""
        far = (1 - 2 * s * s) * self.along + 2 * s * c * self.turned - self.aside
        return self.power(self.least + self.swing * sin * sin, far)

    def power(self, v: Any, cos: Any) -> Any:
        """``max(cos, 0)^exponent``, from ``v = 1 - cos`` for small angles."""
        near = v < 0.5
        u = dr.select(near, 1 - v, cos)
        some = dr.select(u > 0, u, 1)
        log = log_near_one(some, dr.select(near, -v, some - 1))
        return dr.select(u > 0, dr.exp(dr.maximum(self.exponent * log, -EXPONENT_CAP[self.double])), 0)

    def arc(self, weight: Callable[[Any, Any], Any], low: Any, high: Any) -> Any:
        """The integral of the lobe times ``weight(s, c)`` over the normals at angles `low` to `high`, within a right
        angle of the bisector.

        The rule is spread over where the lobe is above rounding, so that sharp lobes are as accurate as broad ones.
        The lobe is told the angle from the bisector, the weight that from z: near grazing neither can be had from the
        other without loss.
        """
        nearest = dr.clip(self.bisector, low, high)
        sin2 = dr.square(dr.sin(nearest - self.bisector))
        room = dr.maximum(1 - self.least - self.swing * sin2, 0)
        fall = room * (1 - dr.exp(-EFOLDS[self.double] / self.exponent))
        inside = fall < self.swing * (1 - sin2)
        edge = sin2 + fall / dr.select(inside, self.swing, 1)
        window = dr.detach(dr.select(inside, dr.asin(dr.sqrt(dr.minimum(edge, 1))), dr.pi))
        near, far = dr.maximum(low - self.bisector, -window), dr.minimum(high - self.bisector, window)
        low, high = dr.maximum(low, self.bisector - window), dr.minimum(high, self.bisector + window)
        half = dr.maximum(0.5 * (high - low), 0)  # near grazing the arc is short, and far from the bisector
        s, c = dr.sincos(0.5 * (low + high))
        ts, tc = dr.sincos(0.5 * (near + far))
        total = 0.0
        crowd = dr.select(self.exponent < KINKED[self.double], half, 0)
        for x, w, shift, more in RULES[self.double]:
            ds, dc = dr.sincos(half * x + crowd * shift)
            weighs = half * w + crowd * more
            for sign in (1, -1):
                d = sign * ds
                sin, cos = s * dc + c * d, c * dc - s * d
                total += weighs * (self.at(ts * dc + tc * d, sin, cos) * weight(sin, cos))
        return total


def diffuse_arc(end: Any, wi: Any, wo: Any, turn: int) -> Any:
    """The integral of ``(c + s ti)(c + s to)``, ``t = turn w.x / w.z``, over the angles 0 to `end` >= 0.

    ``(end + s c)/2 + (ti + to) s^2/2 + ti to (end - s c)/2``. Tangents grow without bound as directions near grazing,
    but reach only small angles then: each is kept together with one factor `end` or `s`.
    """
    s, c = dr.sincos(end)
    ti, to = (turn * w.x / w.z for w in (wi, wo))
    mixed = 0.5 * s * (ti * s + to * s)
    return 0.5 * (end + s * c) + mixed + 2 * (ti * end) * (to * end) * end * cube_remainder_of_sine(2 * end)


def moving_ends(integral: Any, integrand: Callable[[Any, Any], Any], low: Any, high: Any) -> Any:
    """`integral` from `low` to `high`, computed with these detached, and its derivatives through them.

    Leibniz's rule: ``d integral = ... + integrand(high) d high - integrand(low) d low``.
    """
    at_low, at_high = (dr.detach(integrand(*dr.sincos(dr.detach(end)))) for end in (low, high))
    return with_gradient(integral, integral + at_high * high - at_low * low)
