"""The integrators `effects` and `raytree` as Mitsuba plugins.

Both are one integrator with other defaults: `effects` simulates all cells that the scene can have, `raytree` what a
classic ray tracer does. Properties, all optional:

- ``cells`` (string): ``auto``, ``all``, ``classic``, or names of cells (see `table.parse`). What is not named leaves no
  code in the kernel, nor does what the scene does not call for. That is looked up once for each scene: after a change
  of shapes or sensors, make a new integrator. (Colours may change, also from black.) With ``all`` it is not looked up.
- ``max_depth``, ``rr_depth`` (integer, -1, 5), ``hide_emitters``: those of `path`. What is hidden behind thin
  glass and masks, too, is the sky; a lamp there is seen, as `path` has it.
- ``layers`` (boolean): each cell as well, as channels ``diffuse.point.R`` and so on. They sum to the picture.
  With ``parts`` as well, ``mirror.indirect`` is split by what is seen: ``mirror.indirect/diffuse.point.R`` and so on.
- ``threshold`` (float, 0.01): glass, mirrors and glazed surfaces are followed into both branches where each carries at
  least this part of the light at the eye. Below, one is chosen at random (``prune = random``), which is unbiased, or
  what is weaker is left out (``prune = cut``).
- ``tolerance`` (float, 0), for ``cells = auto``: cells are left out that a pilot, at the first picture of a scene,
  finds to change a pixel by less than this part of it together (see `pilot.droppable`). What it dropped: `dropped`.

Derivatives are those of the light along each path: directions and positions follow through mirrors and glass; beyond
a diffuse or glossy surface, the point that is met is held. Edges are not followed: where a shadow, or a lamp without a
soft border, is seen through glass or shines through it, it moves with `eta`, and that part is missing.
It can be most of it: see tests/plugins/test_effects_gradients.py. By the weight of a `blendbsdf` that has a mirror or
glass in it they are right, unless there is a `mask` around or inside the blend: then that part of the light is missing.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from brdf import NoBackend, UsageError

from . import pilot
from .cells import Switches, layer_names
from .contents import contents
from .inventory import absorbing, absorbs, take
from .lights import Lights
from .state import Settings, column_of
from .table import CELLS, SUMMED, called_for, parse, plan
from .walk import run

#: Below this part of the light at the eye, one branch of glass is followed, not both.
THRESHOLD = 0.01
PRUNE = ("random", "cut")
#: The sensors where rays come from elsewhere than `render`.
UNKNOWN = (None,)


def integrator_class(name: str, cells: str) -> type[Any]:
    """The class of Mitsuba plugin of this name, for the variant now set; `cells` is the default of that property."""

    class Effects(mi.SamplingIntegrator):
        """Simulates the cells of the lecture's table that are called for."""

        def __init__(self, props: mi.Properties) -> None:
            mi.SamplingIntegrator.__init__(self, props)
            if not dr.is_jit_v(mi.Float) or mi.is_polarized:
                raise NoBackend(f"{name}: the variant {mi.variant()} will not do. Take llvm_ad_rgb, or one like it.")
            text = string(name, props, "cells", cells)
            self.cells, self.planned = parse(text), text.strip() != "all"
            self.tolerance = number(name, props, "tolerance", 0.0)
            self.max_depth = integer(name, props, "max_depth", -1, low=-1)
            self.rr_depth = integer(name, props, "rr_depth", 5, low=1)
            self.threshold = number(name, props, "threshold", THRESHOLD)
            self.prune = string(name, props, "prune", PRUNE[0])
            if self.prune not in PRUNE:
                raise UsageError(f"{name}: prune = {self.prune!r}. It is one of: {', '.join(PRUNE)}.")
            layers, parts = (flag(name, props, key) for key in ("layers", "parts"))
            self.names = layer_names(parts) if layers else ()
            self.seen: tuple[Any, ...] = ()
            self.black: tuple[Any, ...] = ()
            self.sensors: tuple[Any, ...] = UNKNOWN
            self.piloted: tuple[Any, ...] = ()
            self.dropped: frozenset[str] = frozenset()
            if self.tolerance > 0 and text.strip() != "auto":
                raise UsageError(f"{name}: tolerance is for cells = auto, not for {text!r}. Leave one of them out.")

        def aov_names(self) -> list[str]:
            return [f"{cell}.{c}" for cell in self.names for c in "RGB"]

        def traverse(self, callback: mi.TraversalCallback) -> None:
            pass

        def to_string(self) -> str:
            return (
                f"{name}[cells = {' '.join(c for c in CELLS if c in self.cells)}, max_depth = {self.max_depth}, "
                f"rr_depth = {self.rr_depth}, threshold = {self.threshold:g}, prune = {self.prune}]"
            )

        def render(
            self,
            scene: mi.Scene,
            sensor: Any = 0,
            seed: Any = 0,
            spp: int = 0,
            develop: bool = True,
            evaluate: bool = True,
        ) -> Any:
            if self.tolerance > 0 and not same(parts_of(scene), self.piloted):
                camera = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
                with dr.suspend_grad():
                    self.dropped = self.pilot(scene, camera)
                self.piloted, self.seen = (parts_of(scene),), ()
            own = scene.sensors()
            self.sensors = tuple(own) if isinstance(sensor, int) or sensor in own else (*own, sensor)
            try:
                return mi.SamplingIntegrator.render(self, scene, sensor, seed, spp, develop, evaluate)
            finally:
                self.sensors = UNKNOWN

        def pilot(self, scene: mi.Scene, sensor: Any) -> frozenset[str]:
            """The cells that a few small pictures find to be worth less than the tolerance, together."""
            same_paths = {"max_depth": self.max_depth, "rr_depth": self.rr_depth, "hide_emitters": self.hide_emitters}
            layers = mi.load_dict({"type": name, **same_paths, "layers": True, "parts": True})
            found = pilot.run(pilot.rendered(layers, sensor), scene)
            return pilot.droppable(found, self.tolerance, take(scene).caustics).cells

        def prepared(self, scene: mi.Scene) -> tuple[Any, ...]:
            """What the scene holds, and its lights; looked up once a scene.

            And again once something black is so no more, or its colour is being differentiated.
            """
            held = (*parts_of(scene), *(sensor for sensor in self.sensors if sensor is not None))
            if not same(held, self.seen) or not all(absorbs(bsdf) for bsdf in self.black):
                called = frozenset(CELLS)
                if self.planned:  # with derivatives, which `absorbs` asks about
                    called, self.black = called_for(plan(scene, self.max_depth, sensors=self.sensors)), absorbing(scene)
                with dr.suspend_grad():
                    found = contents(scene)
                    possible = found.possible(self.max_depth) & called
                    switches = Switches.of(self.cells - self.dropped, possible, found.rows)
                    wanted = [e for e in found.others if switches.indirect or switches.wants(column_of(e))]
                    points = Lights(scene, found.points, choose=len(found.points) > SUMMED)
                    self.seen = (held, found, switches, (points, Lights(scene, wanted)))
            return self.seen[1:]

        def sample(
            self,
            scene: mi.Scene,
            sampler: mi.Sampler,
            ray: mi.RayDifferential3f,
            medium: mi.Medium | None = None,
            active: Any = True,
        ) -> tuple[Any, Any, list[Any]]:
            found, switches, lights = self.prepared(scene)
            settings = Settings(
                scene,
                found,
                switches,
                lights,
                max_depth=self.max_depth,
                rr_depth=self.rr_depth,
                threshold=self.threshold,
                cut=self.prune == "cut",
                names=self.names,
                hide=self.hide_emitters,
                # Mitsuba renders a derivative with symbolic loops switched off
                attached=not dr.flag(dr.JitFlag.SymbolicLoops),
            )
            s = run(settings, sampler, ray, active)
            aovs: list[Any] = []
            for cell in self.names:
                aovs += list(rgb(s.light[cell], ray.wavelengths))
            total = mi.Spectrum(0)
            for value in s.light.values():
                total += value
            return total, s.valid, aovs

    Effects.__name__ = Effects.__qualname__ = name
    return Effects


def parts_of(scene: mi.Scene) -> tuple[Any, ...]:
    """By what a scene is known again. Not by itself: it may own the integrator, and neither would ever be freed."""
    return (*scene.shapes(), *scene.emitters())


def same(held: tuple[Any, ...], known: tuple[Any, ...]) -> bool:
    """Whether the first of `known` has the same parts: they are held, so that no others can take their places."""
    return bool(known) and [o.ptr for o in held] == [o.ptr for o in known[0]]


def rgb(value: Any, wavelengths: Any) -> Any:
    """A spectrum in the three channels of a film."""
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, wavelengths)
    return mi.Color3f(value.x) if mi.is_monochromatic else value


def string(owner: str, props: mi.Properties, key: str, default: str) -> str:
    """A property that is a word."""
    value = props[key] if key in props else default
    if not isinstance(value, str):
        raise UsageError(f"{owner}: {key} = {value!r}. It takes a <string>.")
    return value


def flag(owner: str, props: mi.Properties, key: str) -> bool:
    """A property that is true or false; false if it is not there."""
    value = props[key] if key in props else False
    if not isinstance(value, bool):
        raise UsageError(f"{owner}: {key} = {value!r}. It takes a <boolean>.")
    return value


def number(owner: str, props: mi.Properties, key: str, default: float, low: float = 0) -> float:
    """A property that is a number, not below `low`."""
    value = props[key] if key in props else default
    if isinstance(value, bool) or not isinstance(value, int | float) or not value >= low:
        raise UsageError(f"{owner}: {key} = {value!r}. It takes a number from {low:g} on.")
    return value


def integer(owner: str, props: mi.Properties, key: str, default: int, low: int) -> int:
    """A property that is a whole number, not below `low`."""
    value = props[key] if key in props else default
    if isinstance(value, bool) or not isinstance(value, int) or value < low:
        raise UsageError(f"{owner}: {key} = {value!r}. It takes an <integer> from {low} on.")
    return value


def publish() -> None:
    """Register both integrators with the variant now set."""
    for name, cells in (("effects", "auto"), ("raytree", "classic")):
        plugin = integrator_class(name, cells)
        mi.register_integrator(name, lambda props, plugin=plugin: plugin(props))
