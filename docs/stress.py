"""Make docs/stress.png, and print how far float32 is from float64 on it: ``.venv/bin/python docs/stress.py [--table]``.

For the table, each ball of `plugins.scenes.stress` is lit by the grazing lamp alone, and looked at where it is seen and
again where its highlight is, however small. Mitsuba computes in float32; against it stand the same formulas in float64,
at the directions that Mitsuba found, and at directions that are computed in float64 as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any, NamedTuple

import fitting  # before mitsuba: it chooses the libLLVM  # isort: skip  # noqa: F401
import drjit as dr
import matplotlib
import mitsuba as mi
import numpy as np
import numpy.typing as npt
from drjit.llvm.ad import Array3f64, Float64
from matplotlib.figure import Figure
from pictures import HERE, SOFT, STYLE, WIDTH, card
from PIL import Image

from brdf import Values, evaluate
from fitting.images import to_srgb
from fitting.pixels import film_size, rays
from plugins import scene as scenes
from plugins.scenes import FOLDER, stress

Array = npt.NDArray[np.float64]

#: Pixels and samples of the picture, and dots an inch: few, since photographs do not compress.
SIZE, SPP, DOTS = (640, 512), 160, 76
#: Points looked at in each ball, and again in each highlight.
POINTS = 4000
#: A relative error is of the value, but of no less than this share of the ball's largest.
FLOOR = 1e-6
#: The highlight is looked at out to this many times its roughness.
REACH = 2.0


class Row(NamedTuple):
    """A ball, how rough it is, and its relative errors at the same directions and at those of float64, sorted.

    And what they are made of: the light that float32 found, shape (3, n), and the directions it found it at, wi and wo,
    shape (3, n) each.
    """

    ball: stress.Ball
    m: float
    same: Array
    own: Array
    found: Array
    directions: tuple[Array, Array]


def compare() -> Iterator[Row]:
    """Float32 against float64, ball by ball."""
    scene = scenes.load(FOLDER / "stress.xml", width=SIZE[0], height=SIZE[1])
    (camera,) = scene.sensors.values()
    (lamp,) = (e for e in scene.scene.emitters() if e.id() == "grazing")
    places = camera.world_transform().translation(), mi.traverse(lamp)["position"]
    origin, light = (np.array(place, dtype=float).ravel() for place in places)
    shapes = {shape.id(): shape for shape in scene.scene.shapes()}
    for ball in stress.balls():
        shape: Any = shapes[ball.id]
        m = roughness(ball.bsdf)
        film = looked_at(ball, camera, origin, light, m)
        ray, _ = rays(camera, mi.Point2f(film.T.astype(np.float32)))
        pi = shape.ray_intersect_preliminary(ray)
        si = pi.compute_surface_interaction(ray)
        si.shape = mi.ShapePtr(shape)
        ds, _ = lamp.sample_direction(si, mi.Point2f(0.5))
        wo = si.to_local(ds.d)
        dr.eval(si, wo)
        bsdf = shape.bsdf()
        p = values(bsdf)
        if all(lobe.ideal for lobe in bsdf.model.lobes):
            got = mi.Color3f(bsdf.model.ideal(bsdf.values(si, True), si.wi, 0).weight)
        else:
            got = mi.Color3f(bsdf.eval(mi.BSDFContext(), si, wo))
        here = np.array(si.is_valid())
        found = np.broadcast_to(np.array(got, dtype=float), (3, len(here)))[:, here]
        same = np.array(si.wi, dtype=float)[:, here], np.array(wo, dtype=float)[:, here]
        own = directions(ball, *(np.array(v, dtype=float)[:, here] for v in (ray.o, ray.d, si.sh_frame.s)), light)
        errors = (error(found, shade(bsdf.model, p, *where)) for where in (same, own))
        yield Row(ball, m, *errors, found, same)


def roughness(bsdf: dict[str, Any]) -> float:
    """About how wide the highlight is, as a slope."""
    if "exponent" in bsdf:
        return (2 / (bsdf["exponent"] + 2)) ** 0.5
    return min((bsdf[name] for name in ("m", "m_u", "m_v", "alpha_u", "alpha_v") if name in bsdf), default=0.3)


def looked_at(ball: stress.Ball, camera: mi.Sensor, origin: Array, light: Array, m: float) -> Array:
    """Positions on the film [pixels]: half over the ball, half over its highlight."""
    centre = np.array(ball.at)
    normal = np.array([0.0, 0.0, 1.0])
    for _ in range(200):  # where the normal is half way between camera and lamp
        at = centre + ball.radius * normal
        normal = sum((to - at) / np.linalg.norm(to - at) for to in (origin, light))
        normal /= np.linalg.norm(normal)
    width, height = film_size(camera)
    scale = 0.5 * width / np.tan(np.radians(0.5 * float(np.ravel(mi.traverse(camera)["x_fov"])[0])))
    rng = np.random.default_rng(0)
    angle, r = 2 * np.pi * rng.random((2, POINTS)), np.sqrt(rng.random((2, POINTS)))
    disk = r * np.stack([np.cos(angle), np.sin(angle)])
    ends = ((centre, 1.0), (centre + ball.radius * normal, min(REACH * m, 0.2)))
    film = []
    for (point, size), offset in zip(ends, disk.transpose(1, 0, 2), strict=True):
        ahead = scale / (origin[2] - point[2])
        x, y = 0.5 * width + ahead * point[0], 0.5 * height - ahead * point[1]
        film.append(np.array([[x], [y]]) + ahead * ball.radius * size * offset)
    return np.concatenate(film, axis=1).T


def directions(ball: stress.Ball, o: Array, d: Array, s: Array, light: Array) -> tuple[Array, Array]:
    """To the camera and to the lamp in the local frame, in float64, where float32 rays meet the ball."""
    radius = float(np.float32(ball.radius))
    d = d / np.linalg.norm(d, axis=0)
    to = np.array(ball.at)[:, None] - o
    b = (to * d).sum(0)
    miss = to - b * d
    n = (-miss - np.sqrt(np.maximum(radius**2 - (miss**2).sum(0), 0)) * d) / radius
    wo = light[:, None] - np.array(ball.at)[:, None] - radius * n
    wo /= np.linalg.norm(wo, axis=0)
    s = s - (s * n).sum(0) * n
    s /= np.linalg.norm(s, axis=0)
    frame = s, np.cross(n, s, axis=0), n
    return tuple(np.array([(axis * w).sum(0) for axis in frame]) for w in (-d, wo))  # type: ignore[return-value]


def values(bsdf: Any) -> Values:
    """The parameters that a plugin holds, in float64."""
    held = mi.traverse(bsdf)
    out = {}
    for p in bsdf.model.parameters():
        numbers = np.ravel(held[f"{p.name}.value"]).astype(float).tolist()
        out[p.name] = Float64(numbers[0]) if p.kind == "number" else Array3f64(*numbers)
    return Values(**out)


def shade(model: Any, p: Values, wi: Array, wo: Array) -> Array:
    """``f cos``, or the weight of the mirror direction if there are ideal lobes alone, in float64."""
    i, o = Array3f64(wi), Array3f64(wo)
    if all(lobe.ideal for lobe in model.lobes):
        return np.array(Array3f64(model.ideal(p, i, 0).weight))
    return np.array(evaluate(model, p, i, o) * abs(o.z))


def error(found: Array, expected: Array) -> Array:
    """Relative errors, sorted; where there is light."""
    expected = np.broadcast_to(expected, found.shape)
    scale = np.maximum(np.abs(expected), FLOOR * np.abs(expected).max())
    return np.sort((np.abs(found - expected) / np.where(scale > 0, scale, 1))[scale > 0])


def table() -> None:
    """Print the errors of each ball."""
    print("relative difference of float32     at the same directions          at float64's own      own p99")
    print(f"{'ball':<12}{'m':>8}" + 2 * f"  {'median':>9}{'p99':>9}{'max':>9}" + f"{'times m':>11}")
    for row in compare():
        figures = (f"{np.quantile(e, q):9.1e}" for e in (row.same, row.own) for q in (0.5, 0.99, 1))
        a, b, c, d, e, f = figures
        last = row.m * np.quantile(row.own, 0.99)
        print(f"{row.ball.id:<12}{row.m:8.2g}  {a}{b}{c}  {d}{e}{f}{last:11.1e}", flush=True)


def picture() -> Figure:
    """The wall, with the name of each column and what grows in it."""
    scene = scenes.load(FOLDER / "stress.xml", width=SIZE[0], height=SIZE[1])
    linear = sum(np.array(mi.render(scene.scene, spp=SPP // 8, seed=i), dtype=np.float64) for i in range(8)) / 8
    high = 0.96 * WIDTH * SIZE[1] / SIZE[0]
    figure = card(high + 0.75)
    axes = figure.add_axes((0.02, 0.2 / (high + 0.75), 0.96, high / (high + 0.75)))
    axes.set_axis_off()
    axes.imshow(to_srgb(np.clip(1.1 * linear[..., :3], 0, None)), interpolation="bicubic")
    grows = [(name, p, f"{v[0]:.5g} to {v[-1]:.3g}") for name, (_, p, v) in stress.COLUMNS.items()]
    for column, lines in enumerate([*grows, ("others", "one of each", "")]):
        x = 0.5 + 0.96 * (column - 0.5 * len(stress.COLUMNS)) * figure_pitch()
        for line, (text, size) in enumerate(zip(lines, (10, 7.5, 7.5), strict=True)):
            y = 1 - (0.16 + 0.15 * line) / (high + 0.75)
            figure.text(x, y, text, ha="center", va="center", color=SOFT, fontsize=size)
    return figure


def figure_pitch() -> float:
    """From one column to the next, as a share of the picture's width."""
    return 1 / (2 * 24.5 * np.tan(np.radians(12.0)))


def main() -> None:
    """Print the table; without ``--table`` also write the picture beside this file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", action="store_true", help="print the table alone")
    asked = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    table()
    if not asked.table:
        with matplotlib.rc_context(STYLE):
            picture().savefig(HERE / "stress.png", dpi=DOTS, metadata={"Software": None})
        with Image.open(HERE / "stress.png") as image:  # in 256 colours: a third of the size, and no difference to see
            few = image.convert("RGB").quantize(256)
        few.save(HERE / "stress.png", optimize=True)
        print(HERE / "stress.png")


if __name__ == "__main__":
    main()
