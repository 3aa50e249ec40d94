"""Whether light that leaves a shape can meet the same shape again. Not of a flat or convex one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import mitsuba as mi
import numpy as np

#: Points so near a plane lie in it, relative to the size of the mesh: float32 stores a vertex to 6e-8.
PLANAR = 1e-6
#: Faces times corners that are looked at: 32 MB. A larger mesh counts as one that is not convex.
MOST = 4 * 10**6
#: BSDFs that turn the normal about which a surface answers: light may then be sent through the surface.
TILTING = ("BumpMap", "NormalMap")


def meets_itself(shape: mi.Shape, sensors: Iterable[mi.Sensor | None]) -> bool:
    """Whether light that a shape has scattered may arrive at the same shape, with nothing else in the scene.

    False for a rectangle, a disk and a flat mesh. False for a sphere, a cylinder's side and a convex mesh if only the
    outer side answers; or, if the body is closed and opaque, if the sensors are outside. A mesh counts as convex if all
    its corners lie behind the plane of each face, and its normals are those of the faces. True for everything else, and
    for what is not known: the answer errs on that side alone.

    Parameters
    ----------
    sensors : all that look at the scene; None for one that is not known
    """
    kind = shape.class_name()
    if kind == "Disk":
        return False
    if kind in ("Sphere", "Cylinder"):
        closed, even = kind == "Sphere", True
    elif shape.is_mesh():
        mesh = Mesh(shape)
        if mesh.flat():
            return False
        if not mesh.convex():
            return True
        closed, even = mesh.closed(), mesh.even()
    else:
        return True
    bsdf: Any = shape.bsdf()
    if not even or any(b.class_name() in TILTING for b in nested(bsdf)):
        return True
    flags = mi.BSDFFlags
    lobes = [int(bsdf.flags(i)) for i in range(bsdf.component_count())]
    null, inner = int(flags.Null), int(flags.FrontSide if shape.has_flipped_normals() else flags.BackSide)
    if any(lobe & int(flags.Transmission) & ~null for lobe in lobes):  # its Transmission has Null in it as well
        return True
    if not any(lobe & inner for lobe in lobes if not lobe & null):
        return False
    return not closed or any(lobe & null for lobe in lobes) or not all(outside(shape, s) for s in sensors)


class Mesh:
    """Corners and faces of a mesh, and the normals of its faces."""

    def __init__(self, shape: Any) -> None:
        self.corners = np.array(shape.vertex_positions_buffer(), dtype=np.float64).reshape(-1, 3)
        faces = np.array(shape.faces_buffer(), dtype=np.int64).reshape(-1, 3)
        first, second, third = (self.corners[faces[:, i]] for i in range(3))
        area = np.cross(second - first, third - first)
        size = np.linalg.norm(area, axis=1)
        there = size > 0
        self.faces, self.normals = faces[there], area[there] / size[there, None]
        self.size = float(np.ptp(self.corners, axis=0).max(initial=0))
        self.shading = None
        if shape.has_vertex_normals() and not shape.has_face_normals():
            self.shading = np.array(shape.vertex_normals_buffer(), dtype=np.float64).reshape(-1, 3)[self.faces]

    def flat(self) -> bool:
        """Whether all lies in one plane."""
        if not len(self.faces):
            return True
        heights = (self.corners - self.corners[self.faces[0, 0]]) @ self.normals[0]
        return bool(np.abs(heights).max() <= PLANAR * self.size)

    def convex(self) -> bool:
        """Whether no corner is before the plane of a face."""
        if len(self.faces) * len(self.corners) > MOST:
            return False
        planes = np.einsum("ij,ij->i", self.normals, self.corners[self.faces[:, 0]])
        return bool((self.normals @ self.corners.T - planes[:, None]).max() <= PLANAR * self.size)

    def closed(self) -> bool:
        """Whether each edge has a face on either side. A seam, where a corner is stored several times, is none."""
        _, same = np.unique(self.corners, axis=0, return_inverse=True)
        faces = same.reshape(-1)[self.faces]
        edges = np.concatenate([faces[:, pair] for pair in ((0, 1), (1, 2), (2, 0))]).tolist()
        there = {(a, b) for a, b in edges}
        return len(there) == len(edges) and all((b, a) in there for a, b in there)

    def even(self) -> bool:
        """Whether the normals at the corners are those of the faces."""
        if self.shading is None:
            return True
        return bool(np.abs(self.shading - self.normals[:, None, :]).max() <= PLANAR)


def nested(bsdf: mi.BSDF) -> Iterator[mi.BSDF]:
    """A BSDF and those inside it."""
    yield bsdf
    for inner in children(bsdf):
        if isinstance(inner, mi.BSDF):
            yield from nested(inner)


def children(of: Any) -> list[Any]:
    """The objects that an object holds."""

    class Held(mi.TraversalCallback):  # exists only once a variant is set
        def __init__(self, found: list[Any]) -> None:
            super().__init__()
            self.found = found

        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                self.found.append(value)

        def put_value(self, name: str, ptr: Any, flags: Any, cpptype: Any) -> None:
            pass

        def put_object(self, name: str, obj: Any, flags: Any) -> None:
            self.found.append(obj)

    found: list[Any] = []
    of.traverse(Held(found))
    return found


def outside(shape: mi.Shape, sensor: Any) -> bool:
    """Whether all rays of a sensor begin outside the box around a shape; False if that is not known."""
    if sensor is None or sensor.class_name() not in ("PerspectiveCamera", "OrthographicCamera"):
        return False
    # Their rays begin on a flat patch with four corners, before the lens.
    corners = [
        np.array(sensor.sample_ray(0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))[0].o).ravel()
        for x in (0, 1)
        for y in (0, 1)
    ]
    box: Any = shape.bbox()
    low, high = (np.array(end, dtype=np.float64).ravel() for end in (box.min, box.max))
    return bool((np.min(corners, axis=0) > high).any() or (np.max(corners, axis=0) < low).any())
