"""The mesh of ``effects/mesh.xml`` and the pictures on it: ``python -m plugins.scenes.torus`` writes them."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from . import FOLDER

#: Radii of the ring and of its tube, and the corners around each.
RING, TUBE = 0.8, 0.34
AROUND, ACROSS = 48, 24
#: Side of the pictures, and how often the pattern comes again around ring and tube.
PIXELS, REPEATS = 128, (12, 6)


def mesh() -> mi.Mesh:
    """A torus about z, with normals; u goes around the ring, v around the tube."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, AROUND + 1), np.linspace(0, 1, ACROSS + 1), indexing="ij"))
    a, b = 2 * np.pi * u, 2 * np.pi * v
    normals = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=1)
    centre = RING * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(AROUND), np.arange(ACROSS), indexing="ij"))
    corner = i * (ACROSS + 1) + j
    beside, across, over = corner + ACROSS + 1, corner + 1, corner + ACROSS + 2
    faces = np.concatenate([np.stack([corner, beside, over], axis=1), np.stack([corner, over, across], axis=1)])
    made = mi.Mesh("torus", len(u), len(faces), has_vertex_normals=True, has_vertex_texcoords=True)
    params = mi.traverse(made)
    params["vertex_positions"] = (centre + TUBE * normals).astype(np.float32).ravel()
    params["vertex_normals"] = normals.astype(np.float32).ravel()
    params["vertex_texcoords"] = np.stack([u, v], axis=1).astype(np.float32).ravel()
    params["faces"] = faces.astype(np.uint32).ravel()
    params.update()
    return made


def pictures() -> tuple[np.ndarray, np.ndarray]:
    """Colours and heights, uint8, that join at the edges."""
    t = (np.arange(PIXELS) + 0.5) / PIXELS
    u, v = np.meshgrid(REPEATS[0] * t, REPEATS[1] * t)
    heights = 0.5 + 0.25 * np.cos(2 * np.pi * u) * np.cos(2 * np.pi * v) + 0.25 * np.cos(2 * np.pi * (u + v))
    stripe = (np.floor(u) + np.floor(v)) % 2
    colours = np.where(stripe[..., None] > 0, (188, 92, 60), (214, 190, 140))
    return colours.astype(np.uint8), np.round(255 * heights.clip(0, 1)).astype(np.uint8)


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    folder = FOLDER / "effects"
    mesh().write_ply(str(folder / "torus.ply"))
    colours, heights = pictures()
    mi.Bitmap(colours).write(str(folder / "colours.png"))
    mi.Bitmap(heights[..., None]).write(str(folder / "bumps.png"))
