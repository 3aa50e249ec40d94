"""Whether a picture can be predicted exactly, or has to be rendered: why not, in words."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

#: Meshes of more faces than this are not examined for being convex.
MOST_FACES = 20_000
#: A vertex this far in front of a face, against the size of the mesh, makes it concave.
FLAT = 1e-5
#: Integrators whose picture is that of `effects`.
ALIKE = ("path", "direct", "prb", "prb_basic")
#: A path of this many segments goes from the camera to a surface and on to a light.
DIRECT = 2


def why_rendered(scene: mi.Scene, sensors: Iterable[mi.Sensor]) -> str | None:
    """None if direct light from points and directions is all there is; else what stands against it.

    It is if every light is a point or a direction, no light goes straight through a surface, and either the scene's
    integrator stops at direct light or the scene is one opaque convex body seen from outside. Or if the scene is one
    flat sheet: whatever goes through that meets nothing.
    """
    for emitter in scene.emitters():
        flags = mi.EmitterFlags
        point = mi.has_flag(emitter.flags(), flags.DeltaPosition)
        direction = mi.has_flag(emitter.flags(), flags.DeltaDirection) and not mi.has_flag(
            emitter.flags(), flags.Surface
        )
        if not (point or direction):
            return f"there is a light that is neither a point nor a direction ({emitter.class_name()})"
    surfaces = [(shape, shape.bsdf().flags()) for shape in scene.shapes()]
    kind = kind_of(scene.integrator())
    followed = kind == "direct" or (("path" in kind or "prb" in kind) and "vol" not in kind)
    flat = len(surfaces) == 1 and surfaces[0][0].class_name() in ("Disk", "Rectangle")
    if flat and followed and not surfaces[0][0].is_medium_transition():
        return None
    if any(shape.is_medium_transition() or mi.has_flag(f, mi.BSDFFlags.Null) for shape, f in surfaces):
        return "light goes straight through a surface (a mask, a thin sheet, or a medium behind it)"
    if kind == "direct":
        return None
    if not followed:
        return f"the scene's integrator is {kind}"
    depth = depth_of(scene.integrator())
    if depth is not None and depth <= DIRECT:
        return None
    opaque = not any(mi.has_flag(f, mi.BSDFFlags.Transmission) for _, f in surfaces)
    if opaque and alone_and_convex(scene) and all(outside(scene, s) for s in sensors):
        return None
    most = "any number of" if depth is None else f"up to {depth - 1}"
    return f"light can go from surface to surface ({kind}, {most} bounces)"


def rendering(scene: mi.Scene) -> mi.Integrator:
    """The integrator that predicts pictures: `effects` in place of those of Mitsuba that render the same, else its own.

    It has less noise where there are several lights, glass or mirrors; and of glass, `path` has wrong derivatives and
    `prb` none.
    """
    own: Any = scene.integrator()
    kind = kind_of(own)
    if kind not in ALIKE or any(shape.is_medium_transition() for shape in scene.shapes()):
        return own
    depth = depth_of(own)
    rr_depth = re.search(r"rr_depth\s*=\s*(\d+)", str(own))
    settings = {
        "type": "effects",
        "max_depth": -1 if depth is None else depth,
        "rr_depth": int(rr_depth[1]) if rr_depth else int(getattr(own, "rr_depth", 5)),
        "hide_emitters": bool(getattr(own, "hide_emitters", False)),
    }
    made: Any = mi.load_dict(settings)
    return made


def refracts(scene: mi.Scene) -> bool:
    """Whether a surface refracts like glass."""
    return any(mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.DeltaTransmission) for shape in scene.shapes())


def kind_of(integrator: mi.Integrator) -> str:
    """The Mitsuba type of an integrator, written in C++ or in Python: ``path``, ``prb``, ``direct``."""
    return str(integrator).split("[")[0].lower().removesuffix("integrator")


def depth_of(integrator: Any) -> int | None:
    """The longest paths of an integrator, in edges from the camera to a light; None for no limit, or if it says none.

    Mitsuba's own print ``max_depth`` and have no attribute for it; none is printed as 2^32 - 1.
    """
    if kind_of(integrator) == "direct":
        return DIRECT
    found = re.search(r"max_depth\s*=\s*(-?\d+)", str(integrator))
    depth = int(found.group(1)) if found else int(getattr(integrator, "max_depth", -1))
    return None if depth < 0 or depth >= 0xFFFFFFFF else depth


def alone_and_convex(scene: mi.Scene) -> bool:
    """Whether the scene holds one shape, which cannot throw light onto itself."""
    shapes = scene.shapes()
    if len(shapes) != 1:
        return False
    kind = shapes[0].class_name()
    if kind in ("Sphere", "Disk", "Rectangle"):
        return True
    return shapes[0].is_mesh() and convex(shapes[0])


def convex(mesh: Any) -> bool:
    """Whether all vertices of a mesh lie behind each of its faces."""
    if mesh.face_count() > MOST_FACES:
        return False
    params = mi.traverse(mesh)
    points = np.array(params["vertex_positions"], dtype=float).reshape(-1, 3)
    faces = np.array(params["faces"], dtype=int).reshape(-1, 3)
    a, b, c = (points[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    size = np.ptp(points, axis=0).max()
    real = length > 1e-12 * size**2
    normal = normal[real] / length[real, None]
    ahead = np.concatenate(
        [(part @ points.T).max(axis=1) for part in np.array_split(normal, max(1, len(normal) // 256))]
    )
    return bool(np.all(ahead - np.einsum("ij,ij->i", normal, a[real]) <= FLAT * size))


def outside(scene: mi.Scene, sensor: mi.Sensor) -> bool:
    """Whether a camera sees front faces alone (checked on a coarse grid of its rays)."""
    i = dr.arange(mi.UInt32, 64 * 64)
    at = mi.Point2f((mi.Float(i % 64) + 0.5) / 64, (mi.Float(i // 64) + 0.5) / 64)
    ray, _ = sensor.sample_ray(sensor.shutter_open(), 0.5, at, mi.Point2f(0.5, 0.5))
    si = scene.ray_intersect(ray)
    return not bool(dr.any(si.is_valid() & (dr.dot(ray.d, si.n) > 0)))
