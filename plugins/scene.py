"""A Mitsuba scene file as a fit sees it: its sensors and its BSDFs by the names their author gave them."""

from __future__ import annotations

import difflib
import gc
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi

from brdf.errors import DataError, UsageError

from . import peers
from .registry import register

#: Textures that are one value everywhere.
CONSTANT_TEXTURES = ("uniform", "srgb", "d65")


@dataclass(frozen=True)
class Bsdf:
    """One BSDF of a scene.

    Attributes
    ----------
    id : str
        Its name: see `parse`.
    bsdf : mi.BSDF
        The live object.
    plugin : str
        Its Mitsuba type, as in XML.
    props : dict
        What the XML gives as plain text, number or colour: the choices made, among others.
    parents : tuple of mi.BSDF
        What ``shape.bsdf()`` returns on the shapes that use it: itself, or the wrappers it is nested in. Empty if no
        shape does.
    location : str
        ``scene.xml:12``.
    """

    id: str
    bsdf: mi.BSDF
    plugin: str
    props: dict[str, Any]
    parents: tuple[mi.BSDF, ...]
    location: str


@dataclass(frozen=True)
class Scene:
    """A loaded scene: `sensors` and `bsdfs` by name, in file order."""

    path: Path
    scene: mi.Scene
    sensors: dict[str, mi.Sensor]
    bsdfs: dict[str, Bsdf]


@dataclass(frozen=True)
class Parsed:
    """A scene file after parsing, before any object is made: `names` gives each BSDF's index in ``state.nodes``."""

    config: mi.parser.ParserConfig
    state: mi.parser.ParserState
    names: dict[str, int]

    def node(self, name: str) -> mi.parser.SceneNode:
        """The node of the BSDF of this name, or `UsageError`."""
        return self.state.nodes[self.names[known(name, self.names, "BSDF")]]


def load(path: str | os.PathLike[str], /, **defaults: object) -> Scene:
    """Load a scene file in the variant now set.

    Nothing is merged: two equal BSDFs stay two. Colours given as one number become three that can be told apart, and
    every shape, sensor and BSDF without an id gets its name as id, so that ``mi.traverse`` gives no addresses for them.

    Parameters
    ----------
    path : path of a Mitsuba XML file
    defaults : values for ``$name`` in the file

    Raises
    ------
    DataError
        A file is missing or cannot be read, a plugin is unknown, a parameter is wrong: one line, with file and line.
    UsageError
        A default that the file does not use.
    """
    gc.collect()  # objects of an earlier scene, freed only while Dr.Jit traces a render, crash it
    with searching(path):
        parsed = parse(path, defaults)
        state = parsed.state
        given = {name: plain(state.nodes[i].props) for name, i in parsed.names.items()}
        for i in range(len(state.nodes)):
            if state.nodes[i].type == mi.ObjectType.BSDF:
                separate(state, i)
                peers.tell_colours_apart(state.nodes[i].props)
        forget_reading(state)
        with explained(path):
            try:
                scene = mi.parser.instantiate(parsed.config, state)
            except RuntimeError:
                state.nodes.clear()  # lets go of the objects made so far, which a traceback would keep
                raise
    if not isinstance(scene, mi.Scene):
        raise DataError(f"{path}: holds a {state.root.props.plugin_name()}, not a scene. Its root should be <scene>.")
    found = live(scene)
    bsdfs = {}
    for name, index in parsed.names.items():
        if name in found.objects:
            plugin, where = state.nodes[index].props.plugin_name(), location(state, state.nodes[index])
            users = tuple(found.parents.get(name, {}).values())
            bsdfs[name] = Bsdf(name, found.objects[name], plugin, given[name], users, where)
    sensors = {s.id() or f"sensor[{i}]": s for i, s in enumerate(scene.sensors())}
    return Scene(Path(path), scene, sensors, bsdfs)


def find(scene: Scene, name: str) -> Bsdf:
    """The BSDF of this name.

    Raises
    ------
    UsageError
        No such BSDF: the message names the near ones and all.
    """
    return scene.bsdfs[known(name, scene.bsdfs, "BSDF")]


def leaf(bsdf: mi.BSDF, param: str) -> tuple[mi.SceneParameters, str]:
    """Where ``mi.traverse`` keeps a parameter of a BSDF: ``m`` is ``m.value``, ``eta`` of `roughdielectric` is ``eta``.

    Returns
    -------
    (params, key)
        ``params[key]`` is the value; after a change call ``params.update()``.

    Raises
    ------
    UsageError
        The BSDF has no such parameter, or it is a texture.
    """
    params = mi.traverse(bsdf)
    keys = list(params.keys())
    for key in (param, f"{param}.value"):
        if key in keys:
            return params, key
    if any(key.startswith(f"{param}.") for key in keys):
        raise UsageError(
            f"{bsdf.id()}: {param} is a texture or a spectrum over wavelengths. A fit takes one number or one colour: "
            f"give {param} as <float> or <rgb> in the scene."
        )
    names = list(dict.fromkeys(key.split(".")[0] for key in keys))
    raise UsageError(f"{bsdf.id()}: {param!r} is not a parameter of this BSDF. {near(param, names)}")


def parse(
    path: str | os.PathLike[str], defaults: Mapping[str, object], unused: mi.LogLevel = mi.LogLevel.Error
) -> Parsed:
    """Parse a scene file and name its BSDFs. Call it inside `searching`.

    The name of a BSDF is its XML id, wherever it stands: in a shape, in another BSDF, at the top, in an included file.
    Without an id it is ``OWNER.bsdf``, the owner being the nearest thing around it that has a name: a BSDF with an id,
    or the shape (its id, else ``shape[2]``, counting all shapes in file order, from 0). Wrappers without an id, such as
    a plain ``twosided``, have no name and own nothing: what is inside them is named as if it stood there itself.
    Several BSDFs of the same owner are ``OWNER.bsdf[0]``, ``OWNER.bsdf[1]``, in file order.

    Parameters
    ----------
    defaults : values for ``$name``
    unused : what to do about one that the file does not use

    Raises
    ------
    DataError, UsageError
        As `load`.
    """
    register()
    variant = mi.variant()
    if variant is None:
        raise UsageError("no Mitsuba variant is set. Call mi.set_variant('llvm_ad_rgb') first.")
    config = mi.parser.ParserConfig(variant)
    config.unused_parameters = unused
    config.merge_equivalent = config.merge_meshes = config.parallel = False
    if not Path(path).is_file():
        raise DataError(f"{path}: {'is a folder, not a scene' if Path(path).is_dir() else 'no such file'}.")
    with explained(path):
        state = mi.parser.parse_file(config, os.fspath(path), **{k: str(v) for k, v in defaults.items()})
        inside = {i: parent for parent, node in enumerate(state.nodes) for i in references(node)}
        mi.parser.transform_all(config, state)
        return Parsed(config, state, name_nodes(state, inside))


def name_nodes(state: mi.parser.ParserState, inside: Mapping[int, int]) -> dict[str, int]:
    """Names of BSDFs, by the rule of `parse`. Sets them as ids, as well as ``shape[2]`` and ``sensor[0]``."""
    nodes = list(state.nodes)
    kinds = mi.ObjectType
    for kind, word in ((kinds.Shape, "shape"), (kinds.Sensor, "sensor")):
        for count, node in enumerate(n for n in nodes if n.type == kind):
            if not node.props.id():
                node.props.set_id(f"{word}[{count}]")
    found = {}
    claims: dict[str, list[int]] = {}
    for i, node in enumerate(nodes):
        if node.type != kinds.BSDF:
            continue
        if node.props.id():
            found[i] = node.props.id()
        elif not any(nodes[j].type == kinds.BSDF for j in references(node)):
            owner = inside.get(i)
            while owner is not None and not nodes[owner].props.id():
                owner = inside.get(owner)
            if owner is not None:
                claims.setdefault(f"{nodes[owner].props.id()}.bsdf", []).append(i)
    given = {name: i for i, name in found.items()}
    for name, indices in claims.items():
        for count, i in enumerate(indices):
            found[i] = name if len(indices) == 1 else f"{name}[{count}]"
            if found[i] in given:
                here, there = (location(state, nodes[j]) for j in (i, given[found[i]]))
                raise DataError(f"{there}: the id {found[i]!r} is what the BSDF at {here} is called too. Change it.")
    for i, name in found.items():
        nodes[i].props.set_id(name)
    return {found[i]: i for i in sorted(found)}


def references(node: mi.parser.SceneNode) -> list[int]:
    """Indices of the nodes this one holds."""
    values = (node.props[key] for key in node.props.keys())  # noqa: SIM118  (mi.Properties does not iterate)
    return [v.index() for v in values if isinstance(v, mi.Properties.ResolvedReference)]


def separate(state: mi.parser.ParserState, index: int) -> None:
    """Give a BSDF its own copy of each constant it takes by <ref>: a fit then changes this BSDF alone."""
    props = state.nodes[index].props
    held = {key: props[key] for key in props.keys()}  # noqa: SIM118
    for key, value in held.items():
        if isinstance(value, mi.Properties.ResolvedReference):
            copy = mi.parser.SceneNode(state.nodes[value.index()])
            if copy.type == mi.ObjectType.Texture and copy.props.plugin_name() in CONSTANT_TEXTURES:
                state.nodes.append(copy)  # from here on, references to nodes that Python held are stale
                state.nodes[index].props[key] = mi.Properties.ResolvedReference(len(state.nodes) - 1)


def forget_reading(state: mi.parser.ParserState) -> None:
    """Mark every property as unread: reading one in Python stops Mitsuba's error for those that no plugin asks for."""
    for node in state.nodes:
        for key in node.props.keys():  # noqa: SIM118
            node.props.mark_queried(key, False)


def plain(props: mi.Properties) -> dict[str, Any]:
    """The properties that are text, numbers or colours."""
    out: dict[str, Any] = {}
    for key in props.keys():  # noqa: SIM118
        value: Any = props[key]
        if isinstance(value, str | bool | int | float):
            out[key] = value
        elif props.type(key) == mi.Properties.Type.Color:
            out[key] = tuple(float(c) for c in value)
    return out


@dataclass
class Found:
    """The BSDFs of a scene: `objects` by id, and by id the `parents` in which shapes hold them."""

    objects: dict[str, mi.BSDF] = field(default_factory=dict)
    parents: dict[str, dict[int, mi.BSDF]] = field(default_factory=dict)


def live(scene: mi.Scene) -> Found:
    """The BSDFs of a scene, by the ids that `name_nodes` gave them."""

    class Walk(mi.TraversalCallback):  # exists only once a variant is set
        def __init__(self, found: Found, in_shape: bool, top: mi.BSDF | None = None) -> None:
            super().__init__()
            self.found, self.in_shape, self.top = found, in_shape, top

        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                self.put_object(name, value, flags)

        def put_value(self, name: str, ptr: Any, flags: Any, cpptype: Any) -> None:
            pass

        def put_object(self, name: str, obj: Any, flags: Any) -> None:
            if isinstance(obj, mi.BSDF):
                top = self.top or (obj if self.in_shape else None)
                self.found.objects[obj.id()] = obj
                if top is not None:
                    self.found.parents.setdefault(obj.id(), {})[hash(top)] = top
                obj.traverse(Walk(self.found, self.in_shape, top))
            elif isinstance(obj, mi.Shape):
                obj.traverse(Walk(self.found, True))

    found = Found()  # not in the closure of Walk: a class is a cycle, and would keep the scene until the collector runs
    scene.traverse(Walk(found, False))
    return found


@contextmanager
def searching(path: str | os.PathLike[str]) -> Iterator[None]:
    """Look for files where ``mi.load_file`` does: first in the folder of `path`. After it, forget what <path> added."""
    before: mi.FileResolver = mi.file_resolver()  # pyright: ignore[reportCallIssue]  (not in the stubs)
    resolver = mi.FileResolver(before)
    resolver.prepend(os.path.dirname(os.fspath(path)))
    mi.set_file_resolver(resolver)  # pyright: ignore[reportCallIssue]
    try:
        yield
    finally:
        mi.set_file_resolver(before)  # pyright: ignore[reportCallIssue]


def search_path() -> list[Path]:
    """Where Mitsuba now looks for files, first to last."""
    return [Path(str(folder)) for folder in mi.file_resolver()]  # pyright: ignore[reportCallIssue]


@contextmanager
def explained(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn an exception of Mitsuba's loader into a `DataError` of one line."""
    try:
        yield
    except UnicodeDecodeError:
        raise DataError(f"{path}: holds text that is not UTF-8. Save it as UTF-8.") from None
    except RuntimeError as error:
        text = one_line(str(error))
        if text.startswith("Found unused parameters"):
            raise UsageError(f"{path}: {text[0].lower()}{text[1:]}. The scene has no such $name.") from None
        raise DataError(text if ".xml:" in text or str(path) in text else f"{path}: {text}") from None


def one_line(text: str) -> str:
    """Mitsuba's message as ``scene.xml:12: what``; what a Python plugin said in full, without its traceback."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    text = re.sub(r"\[[\w.]+\.(?:cpp|h):\d+\]\s*", "", text)
    said = re.split(r"Traceback \(most recent call last\):\n(?:[ \t].*\n)*", text)
    if len(said) > 1:
        text = re.sub(r'failed to instantiate bsdf plugin of type "[^"]*": $', "", said[0])
        text += re.sub(r"^(brdf\.errors\.)?(UsageError|DataError|NoBackend): ", "", said[-1])
    broken = re.search(r'Parsing of XML file "(.*?)" failed: (.*?) \(line (\d+), col \d+\)', text)
    if broken:
        text = f"{broken[1]}:{broken[3]}: not well-formed XML: {broken[2]}"
    text = re.sub(r'^.*Error while loading XML file "(.*?)": ', r"\1: ", text, flags=re.S)
    where = list(re.finditer(r"(?:At|Error while loading|While loading) ([^\n]*?) \(line (\d+), col \d+\): ", text))
    if where:
        text = f"{where[-1][1]}:{where[-1][2]}: {text[where[-1].end() :]}"
    text = re.sub(r" \(line (\d+), col \d+\)", r":\1", text)
    text = text.replace(":\n  - ", ": ").replace("\n  - ", ", ")
    return " ".join(text.split())


def location(state: mi.parser.ParserState, node: mi.parser.SceneNode) -> str:
    """File and line of a node: ``scene.xml:12``."""
    return re.sub(r" \(line (\d+), col \d+\)$", r":\1", mi.parser.file_location(state, node))


def known(name: str, names: Mapping[str, Any], what: str) -> str:
    """`name` if it is one of `names`, else `UsageError`."""
    if name in names:
        return name
    raise UsageError(f"there is no {what} {name!r} in this scene. {near(name, names)}")


def near(name: str, names: Mapping[str, Any] | list[str]) -> str:
    """The end of a message about an unknown name."""
    close = difflib.get_close_matches(name, names, 3)
    guess = f"Did you mean {' or '.join(close)}? " if close else ""
    return f"{guess}It has: {', '.join(names) or 'none'}."
