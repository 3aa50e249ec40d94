"""Two ways to predict a picture, one answer: cached hit points against Mitsuba's integrator."""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import fitting
from brdf import UsageError
from fitting import images
from fitting.picture.rendered import RenderedPicture
from tests.fitting import studio
from tests.fitting.problems import grey, here, problem
from tests.fitting.studio import BALL, KEY, RIM, SPHERE, SUN, camera

DIRECT = '<integrator type="direct"/>'
SPOT = """<emitter type="spot"> <transform name="to_world"><lookat origin="1,2,4" target="0,0.2,0" up="0,1,0"/></transform>
  <rgb name="intensity" value="30"/> <float name="cutoff_angle" value="9"/> </emitter>"""
FLOOR = """<bsdf type="lambertian" id="floor"><rgb name="reflectance" value="0.3,0.5,0.4"/></bsdf>
  <shape type="rectangle"> <transform name="to_world"> <scale value="4"/> <rotate x="1" angle="-90"/> <translate y="-1"/>
  </transform> <ref id="floor"/> </shape>"""
WALL = """<bsdf type="diffuse" id="wall"><rgb name="reflectance" value="0.8"/></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="4"/><translate z="-2"/></transform><ref id="wall"/></shape>"""
CARD = '<shape type="rectangle" id="card"> <transform name="to_world"><scale value="2"/></transform> <ref id="ball"/> </shape>'
CUBE = """<shape type="cube"> <transform name="to_world"> <scale value="0.6"/> <rotate x="1" angle="35"/> <rotate y="1"
  angle="40"/> </transform> <ref id="ball"/> </shape>"""


def nested(wrapper: str, before: str = "") -> str:
    """The ball's material inside another BSDF, on the sphere."""
    return f'<shape type="sphere"><bsdf type="{wrapper}">{before}{BALL}</bsdf></shape>'


TEXTURED = """<bsdf type="cooktorrance" id="ball"> <float name="m" value="0.3"/> <float name="eta" value="1.5"/>
    <texture type="checkerboard" name="diffuse_reflectance"> <rgb name="color0" value="0.1,0.2,0.3"/> <rgb name="color1"
    value="0.6,0.4,0.2"/> <transform name="to_uv"><scale x="7" y="5"/></transform> </texture> </bsdf>"""
LENS = {
    "kind": "thinlens",
    "more": '<float name="aperture_radius" value="0.15"/><float name="focus_distance" value="3.4"/>',
}
CROP = "".join(
    f'<integer name="crop_{name}" value="{value}"/>'
    for name, value in {"offset_x": 17, "offset_y": 6, "width": 28, "height": 22}.items()
)

SCENES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "point and direction": ((BALL, SPHERE, camera(32), KEY, SUN), ("ball.m", "ball.eta")),
    "not square": ((BALL, SPHERE, camera((44, 26)), KEY), ("ball.m", "ball.diffuse_reflectance")),
    "crop off the centre": ((BALL, SPHERE, camera((56, 40), film=CROP), KEY), ("ball.m",)),
    "object across the border of the film": ((BALL, CARD, camera(28, "mitchell"), KEY), ("ball.m", "ball.eta")),
    "thin lens": ((BALL, SPHERE, camera(32, **LENS), KEY), ("ball.m",)),
    "thin lens, bright background": ((BALL, SPHERE, WALL, camera(32, **LENS), KEY), ("ball.m",)),
    "spot": ((BALL, SPHERE, camera(32), SPOT), ("ball.m", "ball.diffuse_reflectance")),
    "texture": ((TEXTURED, SPHERE, camera(32), KEY), ("ball.m", "ball.eta")),
    "twosided": ((nested("twosided"), camera(32), KEY, RIM), ("ball.m", "ball.eta")),
    "two materials, shadow": ((BALL, SPHERE, FLOOR, camera((40, 32)), KEY, SUN), ("ball.m", "floor.reflectance")),
    "mesh of many faces": ((BALL, CUBE, camera(40), KEY, SUN), ("ball.m",)),
    "two views": (
        (BALL, SPHERE, camera(28, name="a"), camera((30, 20), "tent", name="b", origin="3,1,2"), KEY),
        ("ball.m", "ball.eta"),
    ),
}


def compare(path: Path, names: list[str], targets: dict[str, np.ndarray], seeds: int = 16, samples: int = 32) -> None:
    """Pictures and Jacobians of both methods, in the mean of many projections, within the noise of the rendered ones.

    A pixel's noise is that of its neighbours, through the filter: so the noise is taken from the seeds.
    """
    exact = problem(path, names, targets, 128)
    x = here(exact)
    columns = [
        exact.parameters.components.index(n)
        for n in (name if name in exact.parameters.components else f"{name}.g" for name in names)
    ]
    e = exact.linearize(x, columns)
    mean = np.column_stack([exact.target + 0.5 * (e.r[0] + e.r[1]), 0.5 * (e.jacobian[0] + e.jacobian[1])])
    spread = np.column_stack([0.5 * (e.r[0] - e.r[1]), 0.5 * (e.jacobian[0] - e.jacobian[1])])
    order = np.lexsort([exact.channel, exact.pixel, exact.view])
    mean, spread = mean[order], spread[order]

    p = problem(path, names, targets, samples, "rendered", halves=1)
    np.testing.assert_array_equal(np.sort(p.pixel), np.sort(exact.pixel))
    order = np.lexsort([p.channel, p.pixel, p.view])
    rendered = []
    for seed in range(seeds):
        for number, picture in enumerate(p.pictures):
            assert isinstance(picture, RenderedPicture)
            picture.seeds = [dr.opaque(mi.UInt32, 10_000 * number + 100 * seed + k) for k in range(4)]
        one = p.linearize(x, columns)
        rendered.append(np.column_stack([p.target + one.r[0], one.jacobian[0]])[order])

    # Projections: onto the picture and its derivatives themselves, and onto random patterns of blocks of neighbours.
    rng = np.random.default_rng(0)
    patterns = np.repeat(rng.standard_normal((len(mean) // 12 + 1, 40)), 12, axis=0)[: len(mean)]
    for column in range(mean.shape[1]):
        onto = np.column_stack([mean, np.abs(mean[:, column]), patterns * np.abs(mean[:, [column]])])
        size = np.abs(mean[:, column]) @ np.abs(onto)
        onto, size = onto[:, size > 0], size[size > 0]  # a red reflectance does nothing to green
        each = np.array([r[:, column] @ onto for r in rendered])
        expected = mean[:, column] @ onto
        own = np.sqrt(spread[:, column] ** 2 @ onto**2)
        se = np.hypot(each.std(axis=0, ddof=1) / np.sqrt(seeds), own)
        t = (each.mean(axis=0) - expected) / se
        assert np.abs(t).max() < 6, (column, t)  # Student's t of 15 degrees of freedom: 3e-5 each
        assert np.all(se < 0.02 * size), (column, se / size)  # a difference of a few percent would show


@pytest.mark.parametrize("name", SCENES)
def test_pictures_and_jacobians_agree(name: str, tmp_path: Path) -> None:
    parts, names = SCENES[name]
    path = studio.write(tmp_path, *parts, integrator=DIRECT)
    scene = mi.load_file(str(path))
    targets = {s.id(): grey(*(int(v) for v in s.film().crop_size())) for s in scene.sensors()}
    compare(path, list(names), targets)


@pytest.mark.parametrize("wrapper", ["normalmap", "bumpmap"])
def test_relief_from_a_picture(wrapper: str, tmp_path: Path) -> None:
    """A material inside another BSDF; the file's name leads from the scene's folder."""
    y, x = np.mgrid[0:16, 0:16] / 16
    if wrapper == "normalmap":
        slope = 0.4 * np.stack([np.sin(2 * np.pi * 3 * x), np.cos(2 * np.pi * 2 * y), np.full_like(x, 2.5)], axis=-1)
        relief, name = 0.5 + 0.5 * slope / np.linalg.norm(slope, axis=-1, keepdims=True), ' name="normalmap"'
    else:
        relief, name = 0.1 * (np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y))[..., None].repeat(3, axis=-1), ""
    images.write(tmp_path / "relief.exr", relief)
    texture = (
        f'<texture type="bitmap"{name}><string name="filename" value="relief.exr"/>'
        '<boolean name="raw" value="true"/></texture>'
    )
    path = studio.write(tmp_path, nested(wrapper, texture), camera(32), KEY, integrator=DIRECT)
    compare(path, ["ball.m", "ball.diffuse_reflectance"], {"camera": grey(32)})


def test_fits_agree(tmp_path: Path) -> None:
    """Either way the same picture gives the same parameters, within the error bars of both, which hold the truth."""
    path = studio.write(tmp_path, BALL, SPHERE, camera(32), KEY)
    picture = studio.noisy(studio.picture(path, 1024, m=0.25, eta=1.6), 0.02, 3, floor=0.01)
    names = {"ball.m": 0.25, "ball.eta": 1.6}
    exact, rendered = (fitting.fit(path, {"camera": picture}, list(names), method=m) for m in ("exact", "rendered"))
    assert (exact.settings["method"], rendered.settings["method"]) == ("exact", "rendered")
    assert exact.converged, exact.status
    assert rendered.converged, rendered.status
    for name, truth in names.items():
        a, b = exact.parameters[name], rendered.parameters[name]
        print(f"{name}: exact {a.value[0]:.5f} +- {a.sd[0]:.5f}, rendered {b.value[0]:.5f} +- {b.sd[0]:.5f}")
        assert abs(a.value[0] - b.value[0]) < 4 * np.hypot(a.sd[0], b.sd[0]), name
        for found in (a, b):
            assert abs(found.value[0] - truth) < 4 * found.sd[0], name
        # A rendering has noise of its own besides the target's.
        assert a.sd[0] / 1.5 < b.sd[0] < 3 * a.sd[0], name


def test_an_id_on_the_wrapper_alone(tmp_path: Path) -> None:
    """The message names what is inside; and a start may stand in the name, as on the command line."""
    nameless = BALL.replace(' id="ball"', "")
    body = f'<bsdf type="twosided" id="both">{nameless}</bsdf>'
    path = studio.write(tmp_path, f'<shape type="sphere">{body}</shape>', camera(24), KEY)
    target = np.full((24, 24, 3), 0.5)
    with pytest.raises(UsageError, match=r"both: .*'twosided' has nothing to fit\. .*named both\.bsdf\.$"):
        fitting.fit(path, {"camera": target}, ["both.m"])
    with pytest.raises(UsageError, match=r"m = 7 is outside"):
        fitting.fit(path, {"camera": target}, ["both.bsdf.m=7"])
