"""What is in a scene, as far as the table of effects asks: how surfaces answer, and what kinds of light there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from brdf.errors import DataError

from .convex import children, meets_itself
from .undivided import undivided


@dataclass(frozen=True, eq=False)
class Kind:
    """Surfaces that answer alike.

    Attributes
    ----------
    diffuse, glossy, mirror : bool
        Which lobes they have; `mirror` is any that sends all light into one direction, also through glass.
    lamp : bool
        Whether they are area lights as well.
    count : int
    example : str
        The id of one, or what it is.
    again : bool
        Whether light from one of them can arrive at one of them: see `convex.meets_itself`.
    """

    diffuse: bool
    glossy: bool
    mirror: bool
    lamp: bool
    count: int
    example: str
    again: bool

    @property
    def smooth(self) -> bool:
        """Whether they send light into many directions."""
        return self.diffuse or self.glossy


@dataclass(frozen=True)
class Inventory:
    """A scene as the table sees it.

    Attributes
    ----------
    kinds : tuple of Kind
        Of surfaces that answer light at all. Black ones, as lamps are unless a BSDF is given, and those that let light
        pass straight (`null`) are not among them.
    points : int
        Lights from one point, or from one direction: point, spot, projector, directional.
    lamps : int
        Area lights.
    sky : bool
        Whether there is an environment.
    spotted : bool
        Whether the environment varies, as an image or a sun does.
    unreachable : int
        Lights that neither a shadow ray nor a reflected one finds: `directionalarea`.
    passes : bool
        Whether a surface lets light pass straight: `null`, `mask`, thin glass.
    """

    kinds: tuple[Kind, ...]
    points: int
    lamps: int
    sky: bool
    spotted: bool
    unreachable: int
    passes: bool

    @property
    def caustics(self) -> bool:
        """Whether mirrors or glass may gather the light of a lamp, or of a sun, on some other surface."""
        return (
            any(kind.mirror for kind in self.kinds)
            and any(kind.smooth for kind in self.kinds)
            and (self.lamps > 0 or self.spotted)
        )


def take(scene: mi.Scene, sensors: Sequence[Any] | None = None) -> Inventory:
    """Go through a scene.

    Parameters
    ----------
    sensors : sequence of mi.Sensor
        All that look at it, None among them for one that is not known. If not given, the scene's own.

    Raises
    ------
    DataError
        It has a participating medium.
    """
    shapes = list(solid(scene))
    black = absorbing(scene)
    with dr.suspend_grad():
        return listed(scene, shapes, black, scene.sensors() if sensors is None else sensors)


def listed(
    scene: mi.Scene, shapes: list[tuple[Any, bool]], black: tuple[Any, ...], sensors: Sequence[Any]
) -> Inventory:
    """The inventory of these shapes, of which those with `black` BSDFs answer nothing."""
    refuse_media(scene, [shape for shape, _ in shapes])
    flags, null = mi.EmitterFlags, int(mi.BSDFFlags.Null)
    emitters = [(emitter, int(emitter.flags())) for emitter in scene.emitters()]
    delta = [(emitter, flag) for emitter, flag in emitters if flag & int(flags.Delta)]
    skies = [flag for emitter, flag in emitters if emitter.is_environment()]
    unreachable = sum(bool(flag & int(flags.Surface)) for _, flag in delta)
    alike: dict[tuple[bool, bool, bool, bool], list[tuple[Any, bool]]] = {}
    for shape, copied in shapes:
        bsdf = shape.bsdf()
        if bsdf is not None and bsdf not in black:
            lobes = answer(bsdf)
            if any(lobes):
                alike.setdefault((*lobes, is_lamp(shape)), []).append((shape, copied))
    return Inventory(
        kinds=tuple(
            Kind(
                *key,
                len(found),
                found[0][0].id() or found[0][0].class_name().lower(),
                # Two can always see each other; whether one can see itself is worth a look.
                len(found) > 1 or found[0][1] or meets_itself(found[0][0], sensors),
            )
            for key, found in alike.items()
        ),
        points=len(delta) - unreachable,
        lamps=len(emitters) - len(delta) - len(skies),
        sky=bool(skies),
        spotted=any(flag & int(flags.SpatiallyVarying) for flag in skies),
        unreachable=unreachable,
        passes=any(bsdf is not None and int(bsdf.flags()) & null for bsdf in (shape.bsdf() for shape, _ in shapes)),
    )


def solid(scene: mi.Scene) -> Iterator[tuple[Any, bool]]:
    """The shapes with BSDFs of their own; and whether there may be several of it, as an instance."""
    instanced = False
    for shape in scene.shapes():
        if shape.class_name() == "Instance":
            instanced = True  # its own BSDF is never used
        else:
            yield shape, False
    if instanced:
        for group in children(scene):
            if isinstance(group, mi.Shape) and group.class_name() == "ShapeGroupPlugin":
                yield from ((shape, True) for shape in children(group) if isinstance(shape, mi.Shape))


def answer(bsdf: Any) -> tuple[bool, bool, bool]:
    """Whether a BSDF has diffuse lobes, glossy ones, and ones of a single direction. Light that passes is none.

    One that is `undivided` has no diffuse ones: all of it counts as glossy.
    """
    has, flags = int(bsdf.flags()), mi.BSDFFlags
    single = int(flags.DeltaReflection) | int(flags.DeltaTransmission)  # flags.Delta has Null in it as well
    diffuse = bool(has & int(flags.Diffuse)) and not undivided(bsdf)
    return diffuse, bool(has & int(flags.Glossy)), bool(has & single)


def absorbing(scene: mi.Scene) -> tuple[Any, ...]:
    """The BSDFs that `absorbs` says are black now."""
    bsdfs = {shape.bsdf().ptr: shape.bsdf() for shape, _ in solid(scene) if shape.bsdf() is not None}
    return tuple(bsdf for bsdf in bsdfs.values() if absorbs(bsdf))


def absorbs(bsdf: Any) -> bool:
    """Whether it is black, as Mitsuba makes lamps that have no BSDF; not while its colour is being differentiated."""
    if bsdf.class_name() != "SmoothDiffuse":
        return False
    params = mi.traverse(bsdf)
    if "reflectance.value" not in params:
        return False
    value = params["reflectance.value"]
    return not dr.grad_enabled(value) and not np.any(np.array(value))


def is_lamp(shape: Any) -> bool:
    """Whether it is an area light that rays find."""
    emitter = shape.emitter()
    return emitter is not None and not int(emitter.flags()) & int(mi.EmitterFlags.Delta)


def refuse_media(scene: mi.Scene, shapes: list[Any]) -> None:
    """Raise `DataError` if there is fog, smoke or the like."""
    for shape in shapes:
        for medium in (shape.interior_medium(), shape.exterior_medium()):
            if medium is not None:
                refuse(f"the shape {shape.id() or shape.class_name()!r}")
    for what, objects in (("sensor", scene.sensors()), ("light", scene.emitters())):
        for found in objects:
            if found.get_medium() is not None:
                refuse(f"the {what} {found.id() or found.class_name()!r}")


def refuse(what: str) -> None:
    """Say that there is a medium."""
    raise DataError(
        f"{what} borders on a participating medium, and effects knows surfaces alone. Take the medium out, or render "
        "with Mitsuba's volpath."
    )
