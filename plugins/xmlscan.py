"""An XML file as bytes with places: where each element and each attribute stands, so that one can be changed alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

from brdf.errors import DataError

TOKEN = re.compile(
    rb"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<!DOCTYPE(?:[^\[>]|\[.*?\])*>"
    rb"|<(?P<close>/?)(?P<name>[^\s/>=!?]+)(?P<attributes>(?:\s*[^\s=/>]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(?P<empty>/?)>",
    re.S,
)
ATTRIBUTE = re.compile(rb"([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')", re.S)
ENTITIES = {"lt": "<", "gt": ">", "amp": "&", "quot": '"', "apos": "'"}


@dataclass
class Element:
    """One element of an XML file, by its places in the bytes."""

    tag: str
    start: int
    opened: int
    attributes: dict[str, tuple[int, int]]
    empty: bool
    end: int = 0
    children: list[Element] = field(default_factory=list)

    def walk(self) -> Iterator[Element]:
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass
class File:
    """A scene file or one that it includes: its bytes as UTF-8, what it leads to, and the changes to make."""

    path: Path
    text: bytes
    codec: str | None
    root: Element
    links: list[Link] = field(default_factory=list)
    edits: list[tuple[int, int, bytes]] = field(default_factory=list)
    copy: Path | None = None

    def raw(self, element: Element, attribute: str) -> str:
        """The text of an attribute as written; empty without it."""
        start, end = element.attributes.get(attribute, (0, 0))
        return self.text[start:end].decode("utf-8", "surrogateescape")

    def changed(self) -> bytes:
        """The whole file with its changes, in its own encoding."""
        out, done = [], 0
        for start, end, new in sorted(self.edits, key=lambda edit: edit[0]):
            out += [self.text[done:start], new]
            done = end
        text = b"".join([*out, self.text[done:]])
        return text if self.codec is None else text.decode().encode(self.codec, "xmlcharrefreplace")


@dataclass
class Link:
    """An <include> or a <path>: where its name stands, the name, where else Mitsuba looks for it, what it leads to."""

    place: tuple[int, int]
    name: str
    folders: list[Path]
    target: Path
    file: File | None = None


def is_object(element: Element) -> bool:
    """Whether Mitsuba makes an object of an element, <scene> apart: it has a type."""
    return "type" in element.attributes


def read(path: Path) -> File:
    """Read a file as Mitsuba does: UTF-16 by its first bytes, Latin-1 if declared, everything else taken as UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}.") from None
    codec = None
    declared = re.match(rb"<\?xml[^>]*encoding\s*=\s*[\"']([\w.-]+)[\"']", raw)
    if raw[:2] in (b"\xff\xfe", b"<\0"):
        codec = "utf-16-le"
    elif raw[:2] in (b"\xfe\xff", b"\0<"):
        codec = "utf-16-be"
    elif declared and declared[1].lower() in (b"iso-8859-1", b"latin1"):
        codec = "latin-1"
    text = raw if codec is None else raw.decode(codec).encode()
    return File(path, text, codec, scan(path, text))


def scan(path: Path, text: bytes) -> Element:
    """The root element of a file that Mitsuba has accepted, with all that is in it."""
    stack: list[Element] = []
    for m in TOKEN.finditer(text):
        if m["name"] is None:
            continue
        if not m["close"]:
            at = m.start("attributes")
            found: dict[str, tuple[int, int]] = {}
            for a in ATTRIBUTE.finditer(m["attributes"]):
                found.setdefault(a[1].decode("utf-8", "replace"), (at + a.start(2) + 1, at + a.end(2) - 1))
            tag = m["name"].decode("utf-8", "replace")
            element = Element(tag, m.start(), m.end(), found, bool(m["empty"]), m.end())
            if stack:
                stack[-1].children.append(element)
            stack.append(element)
        if m["close"] or m["empty"]:
            done = stack.pop()
            done.end = m.end()
            if not stack:
                return done
    raise DataError(f"{path}: not well-formed XML.")


def substitute(text: str, values: Mapping[str, str]) -> str:
    """An attribute as Mitsuba understands it: entities and ``$name`` replaced."""
    text = re.sub(r"&#(x?)([0-9a-fA-F]+);", lambda m: chr(int(m[2], 16 if m[1] else 10)), text)
    text = re.sub(r"&(lt|gt|amp|quot|apos);", lambda m: ENTITIES[m[1]], text)
    for name in sorted(values, key=len, reverse=True):
        text = re.sub(rf"(?<!\\)\${re.escape(name)}", lambda m, value=values[name]: value, text)
    return text.replace("\\$", "$")


def snake_case(name: str) -> str:
    """``diffuseReflectance``, of files older than version 2, as ``diffuse_reflectance``."""
    return re.sub(r"(?<=[a-z])([A-Z]+)", lambda m: f"_{m[1].lower()}", name)


def indentation(text: bytes, at: int) -> bytes | None:
    """The line break and the blanks before a place, or None if something else stands before it on its line."""
    found = re.search(rb"\r?\n[ \t]*$", text[max(0, at - 1000) : at])
    return found[0] if found else None


def attribute_text(text: str) -> bytes:
    """Text as it stands between the quotes of an attribute."""
    return escape(text.replace("$", "\\$"), {'"': "&quot;", "'": "&apos;"}).encode()
