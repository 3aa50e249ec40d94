"""Write fitted values into a Mitsuba scene file, every other byte as it was, and a material into a file of its own."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from brdf.errors import DataError

from . import peers
from .peers import Value
from .scene import Parsed, parse, search_path, searching
from .xmlscan import Element, File, Link, attribute_text, indentation, is_object, read, snake_case, substitute


def rewrite(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Value]],
    /,
    **defaults: object,
) -> list[Path]:
    """Write the scene file `path` to `out` with new values of some parameters, and nothing else changed.

    If `out` is in another folder, a <path> element is added that leads back to the files of the scene. An included file
    in which something changes is copied beside `out`, as ``OUT.NAME.xml``, and the <include> points to the copy.

    Parameters
    ----------
    values : for each BSDF, by the name that `scene.parse` gives it, for each parameter: a number, or linear RGB
    defaults : values for ``$name``, as in `scene.load`; they are written as <default> elements

    Returns
    -------
    list of Path
        The files written, `out` last.

    Raises
    ------
    UsageError
        No BSDF of that name.
    DataError
        The file cannot be read or written.
    """
    path, out = Path(path), Path(out)
    with searching(path):
        folders = search_path()  # before <path> adds to it
        parsed = parse(path, defaults)
        files = follow(path, parsed, {k: str(v) for k, v in defaults.items()}, folders)
    for name, given in values.items():
        node = parsed.node(name)
        change(files[node.file_index], parsed, name, {param: tidy(value) for param, value in given.items()})

    written = []
    home, there = path.resolve().parent, out.parent.resolve()
    for number in reversed(range(1, len(files))):  # what a file includes comes after it
        file = files[number]
        if file.edits or any(link.file and link.file.copy for link in file.links):
            file.copy = out.parent / f"{out.stem}.{file.path.name}"
            while file.copy in written or any(file.copy.resolve() == f.path.resolve() for f in files):
                file.copy = file.copy.with_name(f"{file.copy.stem}-{number}{file.copy.suffix}")
            written.append(file.copy)
    main = files[0]
    main.copy = out
    if not main.root.empty:
        # The first <default> of a name holds, so these go before those of the file.
        pair = b'<default name="%s" value="%s"/>'
        lines = [pair % (attribute_text(name), attribute_text(str(value))) for name, value in defaults.items()]
        if there != home:
            lines.append(b'<path value="' + attribute_text(relative(home, there)) + b'"/>')
        first = main.root.children[0].start if main.root.children else main.root.end
        space = indentation(main.text, first) or b""
        main.edits += [(main.root.opened, main.root.opened, space + line) for line in lines]
    for file in reversed(files):
        if file.copy:
            for link in file.links:
                target = (link.file and link.file.copy) or link.target
                if resolve(link.name, [there, *link.folders]).resolve() != target.resolve():
                    file.edits.append((*link.place, attribute_text(relative(target.resolve(), there))))
            save(file.copy, file.changed())
    return [*written, out]


def material(
    path: str | os.PathLike[str],
    name: str,
    values: Mapping[str, Value],
    out: str | os.PathLike[str],
    comment: str = "",
    /,
    **defaults: object,
) -> None:
    """Write one BSDF of a scene, with new values, as a file of its own: ``mi.load_file(out)`` is the BSDF.

    ``$name`` and <ref> are written out. File names are absolute: whatever file includes this one, they lead to the same
    place. A nested BSDF stands alone.

    Parameters
    ----------
    comment : str
        Stands at the top.

    Raises
    ------
    UsageError, DataError
        As `rewrite`.
    """
    path, out = Path(path), Path(out)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.xml"
        rewrite(path, scene, {name: values}, **defaults)
        with searching(scene):
            parsed = parse(scene, defaults, unused=mi.LogLevel.Debug)  # a $name may just have been replaced
            state = extract(parsed.state, parsed.names[name])
            folders = search_path()
        for node in state.nodes:
            for key in node.props.keys():  # noqa: SIM118  (mi.Properties does not iterate)
                if "filename" in key and isinstance(node.props[key], str):
                    found = resolve(node.props[key], folders)
                    if found.exists():
                        node.props[key] = str(found.resolve()).replace("$", "\\$")
    text = re.sub(r"<(?!string\b)[^>]*>", lambda m: shorter(m[0]), mi.parser.write_string(state))
    if name in parsed.state.id_to_index:  # an id from the file, not a name of ours
        text = re.sub(r'type="[^"]*"', lambda m: f'{m[0]} id="{attribute_text(name).decode()}"', text, count=1)
    said = re.sub(r"-(?=-|$)", "- ", " ".join((comment or f"{name} of {path.name}, fitted").split()))
    save(out, f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {said} -->\n{text}'.encode())


def change(file: File, parsed: Parsed, name: str, given: Mapping[str, Value]) -> None:
    """Add to `file.edits` what gives one BSDF these values."""
    node = parsed.node(name)
    bsdf = next((e for e in file.root.walk() if e.start + 1 == node.offset), None)
    if bsdf is None:
        raise DataError(f"{file.path}: the BSDF {name!r} cannot be found again. Was the file changed meanwhile?")
    values, gone = peers.as_xml(node.props.plugin_name(), node.props, given)
    children = {snake_case(file.raw(child, "name")): child for child in bsdf.children}
    new = []
    for param, value in values.items():
        child = children.get(param)
        if child is None:
            if param in node.props:
                raise DataError(
                    f"{file.path}: cannot see where {param} of {name!r} is set. Give it as <float> or <rgb>."
                )
            new.append(element(param, value))
            continue
        tags = ("rgb",) if isinstance(value, tuple) else () if isinstance(value, str) else ("float", "spectrum")
        if "value" in child.attributes and child.tag in tags and not isinstance(value, str):
            file.edits.append((*child.attributes["value"], numbers(value).encode()))
        else:
            file.edits.append((child.start, child.end, element(file.raw(child, "name"), value)))
    for param in gone:
        if param in children:
            child = children[param]
            before = indentation(file.text, child.start) or b""
            file.edits.append((child.start - len(before), child.end, b""))
    insert(file, bsdf, new)


def insert(file: File, bsdf: Element, new: list[bytes]) -> None:
    """Add elements after the last child of a BSDF, each on a line of its own if that is how the file is written."""
    if not new:
        return
    outer = indentation(file.text, bsdf.start)
    if bsdf.children:
        inner = indentation(file.text, bsdf.children[-1].start) or b""
        at = bsdf.children[-1].end
        file.edits.append((at, at, b"".join(inner + e for e in new)))
        return
    body = b"".join((outer + b"    " if outer else b"") + e for e in new)
    if not bsdf.empty:
        follows = outer if outer and file.text.startswith(b"</", bsdf.opened) else b""
        file.edits.append((bsdf.opened, bsdf.opened, body + follows))
        return
    slash = file.text.rindex(b"/", bsdf.start, bsdf.opened)
    while file.text[slash - 1 : slash].isspace():
        slash -= 1
    file.edits.append((slash, bsdf.opened, b">" + body + (outer or b"") + b"</" + bsdf.tag.encode() + b">"))


def follow(path: Path, parsed: Parsed, values: dict[str, str], folders: list[Path]) -> list[File]:
    """The files of a scene in the order of ``state.files``: each <include> matched with what Mitsuba read for it.

    Mitsuba looks for what <include> and <path> name beside the file they stand in, then in `folders`. A <path> adds to
    these, in an included file until its end.
    """
    files: list[File] = []

    def enter(file: File, folders: list[Path]) -> None:
        files.append(file)
        for e in file.root.walk():
            if e.tag == "default":
                values.setdefault(file.raw(e, "name"), substitute(file.raw(e, "value"), values))
            elif e.tag in ("include", "path"):
                attribute = "filename" if e.tag == "include" else "value"
                name = substitute(file.raw(e, attribute), values)
                target = resolve(name, [file.path.parent, *folders])
                link = Link(e.attributes[attribute], name, list(folders), target)
                file.links.append(link)
                if e.tag == "path":
                    folders.insert(0, target)
                    continue
                link.file = read(target)
                before = len(files)
                enter(link.file, list(folders))
                if len(files) == before + 1 and not any(is_object(x) for x in link.file.root.walk()):
                    files.pop()  # Mitsuba does not count a file from which no object comes

    enter(read(path), folders)
    if [f.path.resolve() for f in files] != [Path(str(f)).resolve() for f in parsed.state.files]:
        raise DataError(f"{path}: its <include> elements cannot be followed. Put the BSDFs into the file itself.")
    return files


def resolve(name: str, folders: list[Path]) -> Path:
    """The first file or folder of this name, as Mitsuba finds it."""
    return next((folder / name for folder in folders if (folder / name).exists()), Path(name))


def relative(path: str | Path, folder: Path) -> str:
    """The way from a folder to a file, as it is written in XML."""
    return Path(os.path.relpath(path, folder)).as_posix()


def element(name: str, value: Value | str) -> bytes:
    """A parameter as XML: <float>, <rgb>, or <spectrum> from a file."""
    if isinstance(value, str):
        return f'<spectrum name="{name}" filename="{value}"/>'.encode()
    return f'<{"rgb" if isinstance(value, tuple) else "float"} name="{name}" value="{numbers(value)}"/>'.encode()


def tidy(value: Any) -> Value:
    """A number, or three, from what NumPy and Dr.Jit make of them."""
    flat = [float(v) for v in np.asarray(value).ravel()]
    return flat[0] if len(flat) == 1 else (flat[0], flat[1], flat[2])


def numbers(value: Value) -> str:
    """A number, or three with commas between."""
    return ", ".join(shortest(v) for v in value) if isinstance(value, tuple) else shortest(value)


def shortest(value: float) -> str:
    """The shortest text that reads back as the same float32 if it is one, else as the same float64."""
    value = float(value)
    single = np.float32(value)
    return str(single if float(single) == value else value)


def shorter(text: str) -> str:
    """``0.29999999999999999`` as ``0.3``: numbers in an attribute that Mitsuba wrote."""
    return re.sub(r"-?\d+\.\d{15,}(?:e[-+]?\d+)?|-?\d+\.\d+e[-+]?\d+", lambda m: repr(float(m[0])), text)


def extract(state: mi.parser.ParserState, root: int) -> mi.parser.ParserState:
    """A node and everything it holds, as a file of its own."""
    order: list[int] = []

    def add(index: int) -> None:
        if index not in order:
            order.append(index)
            props = state.nodes[index].props
            for key in props.keys():  # noqa: SIM118
                if isinstance(props[key], mi.Properties.ResolvedReference):
                    add(props[key].index())

    add(root)
    alone = mi.parser.ParserState()
    alone.nodes = mi.parser.SceneNodeList([mi.parser.SceneNode(state.nodes[i]) for i in order])
    alone.versions = [mi.Version(3, 0, 0)]  # pyright: ignore[reportCallIssue]
    for node in alone.nodes:
        node.file_index = 0
        for key in node.props.keys():  # noqa: SIM118
            if isinstance(node.props[key], mi.Properties.ResolvedReference):
                node.props[key] = mi.Properties.ResolvedReference(order.index(node.props[key].index()))
    return alone


def save(path: Path, data: bytes) -> None:
    """Write a file under a temporary name, then give it its own."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise DataError(f"{path}: cannot be written: {error.strerror}. Choose another folder.") from None
