"""Which models Mitsuba knows: ours, those of installed packages, and anybody's."""

from __future__ import annotations

import math
import sys
from importlib.metadata import entry_points
from pathlib import Path

import mitsuba as mi
from drjit.scalar import Array3f

from brdf import Model, UsageError, builtin, defaults, llvm

from .adapter import plugin_class
from .effects import integrator

GROUP = "brdf.models"
#: What the XML of a BSDF says of itself.
RESERVED = ("type", "id", "name", "version")
_known: dict[str, type[Model]] = {}
_listening = False


def register(*models: type[Model]) -> None:
    """Make models available to Mitsuba as BSDF types, in the variant now set and in every one set later.

    Without arguments: all of `brdf.models`, and the models that installed packages offer through the entry-point group
    ``brdf.models``. With arguments: these classes as well. Call it before or after ``mi.set_variant``, as often as you
    like.

    Parameters
    ----------
    models : subclasses of brdf.Model

    Raises
    ------
    UsageError
        A class that is not a complete model, or whose name another model has.
    NoBackend
        An LLVM variant is set and no libLLVM fits.
    """
    global _listening
    if not _known:
        _known.update(builtin())
        for point in entry_points(group=GROUP):
            try:
                add(point.load())
            except Exception as error:  # a broken package of somebody else's must not stop ours: say so and go on
                print(f"brdf: the model {point.name!r} of {point.value} is left out: {error}", file=sys.stderr)
    for model in models:
        add(model)
    if not _listening:
        mi.detail.add_variant_callback(on_variant)
        _listening = True
    if mi.variant() is not None:
        publish()


def registered() -> dict[str, type[Model]]:
    """Every model that `register` knows, by name."""
    if not _known:
        register()
    return dict(sorted(_known.items()))


def add(model: type[Model]) -> None:
    """Take up one model, after a look at its declaration."""
    if not (isinstance(model, type) and issubclass(model, Model)):
        raise UsageError(f"register takes subclasses of brdf.Model, got {model!r}.")
    name = getattr(model, "name", None)
    if not isinstance(name, str) or not name.isidentifier() or name != name.lower():
        raise UsageError(f"{model.__name__}: name = {name!r}. A model's name is one lower-case word.")
    if not model.lobes:
        raise UsageError(f"{name}: lobes is empty. A model has at least one lobe.")
    if model.f is Model.f and not all(lobe.ideal for lobe in model.lobes):
        raise UsageError(f"{name}: f is not written. A model needs at least f.")
    names = [p.name for p in model.params]
    if len(set(names)) < len(names):
        raise UsageError(f"{name}: a parameter is declared twice: {', '.join(names)}.")
    old = _known.get(name)
    if old is not None and (old.__module__, old.__qualname__) != (model.__module__, model.__qualname__):
        raise UsageError(f"{name}: this name is taken by {old.__module__}.{old.__qualname__}. Choose another.")
    for p in model.params:
        if p.name in RESERVED:
            raise UsageError(f"{name}: a parameter cannot be named {p.name!r}, which means something else in XML.")
        low, high = p.bounds
        if p.kind != "choice" and not low < high:
            raise UsageError(f"{name}: the bounds of {p.name} are {p.bounds}. The first is to be the smaller.")
        if p.scale == "logit" and p.kind != "choice" and not math.isfinite(high):
            raise UsageError(f"{name}: {p.name} has the scale logit, which needs finite bounds. Give them, or use log.")
        p.check(name, p.default)
    if any((Path(mi.__file__).parent / "plugins").glob(f"{name}.*")):
        raise UsageError(f"{name}: this name is taken by a plugin of Mitsuba's own. Choose another.")
    try_out(model())
    _known[name] = model


def try_out(model: Model) -> None:
    """Ask a model for everything once, at its defaults: an entry for each lobe is what its methods must return."""
    up, u = Array3f(0, 0, 1), Array3f(0.5)
    p = defaults(model, Array3f)
    for method, returned in (
        ("f", model.f(p, up, up)),
        ("pdf", model.pdf(p, up, up)),
        ("choose", model.choose(p, up)),
    ):
        if not isinstance(returned, tuple) or len(returned) != len(model.lobes):
            got = f"a tuple of {len(returned)}" if isinstance(returned, tuple) else type(returned).__name__
            want = f"a tuple with one entry a lobe, here {len(model.lobes)}"
            raise UsageError(f"{model.name}: {method} returned {got}. It returns {want}.")
    for i, lobe in enumerate(model.lobes):
        if lobe.ideal:
            model.ideal(p, up, i)
        else:
            model.sample(p, up, u, i)


def publish() -> None:
    """Register every known model, and the integrators, with the variant now set."""
    if mi.variant().startswith("llvm"):
        llvm.require()
    integrator.publish()
    for name, model in _known.items():
        plugin = plugin_class(model)
        mi.register_bsdf(name, lambda props, plugin=plugin: plugin(props))


def on_variant(old: str | None, new: str | None) -> None:
    """Register everything again: each variant has classes of its own."""
    if new is not None and new != old:
        publish()
