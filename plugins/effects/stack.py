"""A stack in each lane of a Dr.Jit loop."""

from __future__ import annotations

from typing import Any, TypeVar

import drjit as dr

T = TypeVar("T")


class Stack:
    """Entries of one PyTree type, last in, first out, in a loop of Dr.Jit; pass `state` through the loop.

    In a symbolic loop (``registers=False``) the entries are in local memory. ``dr.Local`` with a mask (``active=``)
    reads and writes the wrong entries in symbolic loops of the LLVM backend (Dr.Jit 1.5.0), so that it is accessed in
    every lane: lanes that do not take part use a slot behind the last, which nobody reads. Local memory carries no
    derivatives; with ``registers=True`` the entries are variables, chosen by ``dr.select``, which do.

    Parameters
    ----------
    blank : PyTree
        Of the type of an entry.
    size : int
        Entries that fit, at least 1.
    index : type
        The Dr.Jit type of unsigned integers in the loop.
    registers : bool
    """

    def __init__(self, blank: Any, size: int, index: type, registers: bool = False) -> None:
        self.size, self.index, self.registers = size, index, registers
        self.blank = blank
        if registers:
            entries: Any = [dr.copy(blank) for _ in range(size)]
        else:
            entries = dr.alloc_local(type(blank), size + 1, value=blank)
        #: How many entries each lane has, and the entries: loop state.
        self.state = (index(0), entries)

    def full(self) -> Any:
        """Lanes in which no entry fits any more."""
        return self.state[0] >= self.size

    def push(self, entry: Any, active: Any) -> None:
        """Put `entry` on top in the lanes `active`; there the stack must not be `full`."""
        height, entries = self.state
        if self.registers:
            entries = [
                dr.select(active & (height == i), entry, old) if i < self.size else old for i, old in enumerate(entries)
            ]
        else:
            entries.write(entry, dr.select(active, height, self.index(self.size)))
        self.state = (dr.select(active, height + 1, height), entries)

    def pop(self, active: Any) -> tuple[Any, Any]:
        """Take the top entry in the lanes `active`: ``(entry, taken)``, `taken` the lanes that had one."""
        height, entries = self.state
        taken = active & (height > 0)
        height = dr.select(taken, height - 1, height)
        if self.registers:
            entry = self.blank
            for i, candidate in enumerate(entries):
                entry = dr.select(taken & (height == i), candidate, entry)
        else:
            entry = entries.read(dr.select(taken, height, self.index(self.size)))
        self.state = (height, entries)
        return entry, taken
