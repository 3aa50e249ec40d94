# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Fit a sphere
#
# From a picture to a material: the built-in example, what its error bars mean, four solvers on it, a model of your
# own, and a fit that cannot succeed and says so.
#
# `jupytext --to ipynb fit_a_sphere.py` makes a notebook of this file; Jupyter with jupytext opens it as it is.

# %%
import fitting  # before mitsuba: it chooses the libLLVM that Dr.Jit compiles with  # isort: skip
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import mitsuba as mi
import numpy as np
from IPython.display import display
from lommelseeliger import LommelSeeliger

import plugins
from fitting import examples, images, output
from plugins import scene as scenes

mi.set_variant("llvm_ad_rgb")

# %% [markdown]
# ## The picture and its scene
#
# A sphere under two point lights, rendered with m = 0.3 and eta = 1.5, with 2 % of noise added. The scene says where
# the camera and the lights stood. The values of its material are placeholders.

# %%
picture = images.read(examples.FOLDER / "sphere.exr").rgb
print((examples.FOLDER / "sphere.xml").read_text())

plt.figure(figsize=(3, 3))
plt.imshow(images.to_srgb(2 * picture))
plt.axis("off")
plt.show()

# %% [markdown]
# ## The fit
#
# What is to be found is named `ID.PARAM`. No start is given: a coarse grid is tried first.

# %%
WANTED = ["ball.m", "ball.eta", "ball.diffuse_reflectance"]
solution = fitting.fit(examples.FOLDER / "sphere.xml", {"camera": picture}, WANTED)
display(solution)

# %% [markdown]
# The error shows the noise and nothing else. Were the model wrong, the error would have the shape of a highlight or of
# a shadow, and a remark would say so.
#
# A `Solution` holds everything as numbers:

# %%
truth = examples.truth()["sphere"]
for name, estimate in solution.parameters.items():
    value, low, high = (np.round(x, 5).tolist() for x in (estimate.value, estimate.low, estimate.high))
    inside = np.all((estimate.low <= truth[name]) & (truth[name] <= estimate.high))
    print(f"{name}: {value}, between {low} and {high}, truth {truth[name]} {'inside' if inside else 'outside'}")

# %% [markdown]
# ## What the correlations say
#
# Near 0, two parameters are told apart. m and eta rise together a little: a rougher surface has a dimmer highlight, and
# a higher index makes up for some of it. Near 1 or -1, the picture knows a combination of the two and no more.

# %%
for name, row in zip(solution.components, solution.correlation, strict=True):
    print(f"{name:28}" + " ".join(f"{c:5.2f}" for c in row))

# %% [markdown]
# ## What the intervals mean
#
# Take the picture again, with other noise, and the estimate moves. A 95 % interval is made so that 95 of 100 pictures
# give one with the truth inside, if the model and the scene are right. Eight pictures from Mitsuba's `path`, whose
# noise is some 2 % as well; red where the truth is outside:

# %%
scene = scenes.load(examples.FOLDER / "sphere.xml")
params = mi.traverse(scene.scene)
for name, value in truth.items():
    params[f"{name}.value"] = mi.Color3f(value) if isinstance(value, list) else value
params.update()

fig, axes = plt.subplots(1, 2, figsize=(9, 2.6))
for seed in range(8):
    noisy = np.array(mi.render(scene.scene, spp=1024, seed=seed))
    again = fitting.fit(examples.FOLDER / "sphere.xml", {"camera": noisy}, WANTED)
    for ax, name in zip(axes, ("ball.m", "ball.eta"), strict=True):
        e = again.parameters[name]
        inside = e.low[0] <= truth[name] <= e.high[0]
        ax.errorbar(seed + 1, e.value[0], [e.value - e.low, e.high - e.value], fmt="o", color="C0" if inside else "C3")
        ax.axhline(truth[name], color="0.6", linewidth=1, zorder=0)
        ax.set(xlabel="picture", title=name)
        ax.ticklabel_format(useOffset=False)
fig.tight_layout()
plt.show()

# %% [markdown]
# ## Solvers
#
# Levenberg-Marquardt uses the derivative of every pixel; the others only that of the sum. All start at the same point.

# %%
start = {"ball.m": 0.1, "ball.eta": 1.3, "ball.diffuse_reflectance": [0.5, 0.5, 0.5]}
fig, ax = plt.subplots(figsize=(7, 3))
for solver in ("lm", "lbfgs", "adam", "gd"):
    result = fitting.fit(
        examples.FOLDER / "sphere.xml", {"camera": picture}, start, solver=solver, spp=8, max_iterations=300
    )
    first = result.history[0].seconds
    error = [abs(step.values["ball.m"][0] / truth["ball.m"] - 1) for step in result.history]
    ax.loglog([step.seconds - first + 1e-2 for step in result.history], error, label=solver)
    m = result.parameters["ball.m"].value[0]
    print(f"{solver:5} m = {m:.5f} after {result.iterations:3} iterations, {result.seconds:4.1f} s. {result.status}")
ax.set(xlabel="seconds", ylabel="relative error in m")
ax.legend()
plt.show()

# %% [markdown]
# What is left at the end is the noise of the picture and of 8 samples a pixel, the same for all that arrive. `fit`
# raises their number by itself if it is not told how many.
#
# ## A model of your own
#
# `lommelseeliger.py` beside this file is the reflection of dust, in one short class. Registered, it is a type for XML,
# and `moon.xml` uses it: the sun, and two cameras.

# %%
print(Path("lommelseeliger.py").read_text())

# %%
plugins.register(LommelSeeliger)
moon = mi.load_file("moon.xml")
rng = np.random.default_rng(0)
moons = {}
fig, axes = plt.subplots(1, 2, figsize=(6, 3))
for i, (name, ax) in enumerate(zip(("full", "quarter"), axes, strict=True)):
    shown = np.array(mi.render(moon, sensor=i, spp=1024))
    moons[name] = shown * (1 + 0.02 * rng.standard_normal(shown.shape))
    ax.imshow(images.to_srgb(moons[name] / shown.max()))
    ax.set_title(name)
    ax.axis("off")
plt.show()

# %% [markdown]
# ## A fit that cannot succeed
#
# Sought are the albedo of the grains, and g, which says whether they throw light back or on. A full moon shows every
# grain from the side that the light comes from. A brighter moon may be of brighter grains, or of grains that throw back
# more: the picture cannot tell.

# %%
full = fitting.fit("moon.xml", {"full": moons["full"]}, ["dust.albedo", "dust.g"])
display(full)

# %% [markdown]
# The render is as near the picture as noise allows, but the intervals are wide, the correlations near 1, and the
# remarks say why: this picture hardly determines the two. Together with a second one, from another side, it does:

# %%
both = fitting.fit("moon.xml", moons, ["dust.albedo", "dust.g"])
display(both)

# %%
for name, found in (("full moon alone", full), ("with the quarter", both)):
    g = found.parameters["dust.g"]
    print(f"{name}: g = {g.value[0]:.4f}, between {g.low[0]:.4f} and {g.high[0]:.4f}")

# %% [markdown]
# ## What to keep
#
# `output.write` leaves the files that `brdf fit` leaves: the report, the material, the scene with the fitted values.

# %%
with tempfile.TemporaryDirectory() as folder:
    for path in sorted(output.write(solution, folder)):
        print(f"{path.name:14}{path.stat().st_size:8} bytes")
    material = (Path(folder) / "material.xml").read_text()
print()
print(material)
