"""The stack of `effects` against a recursion in Python: the test that sees what masked access to dr.Local does wrong."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from plugins.effects.stack import Stack

LANES, DEPTH = 2000, 7
WORD = 0xFFFFFFFF


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("llvm_ad_rgb")


def mixed(x: Any) -> Any:
    """A number that decides, in each node, which branches there are; in Python and in Dr.Jit."""
    if isinstance(x, int):
        x = (x * 747796405 + 2891336453) & WORD
        return x ^ (x >> 16)
    x = x * mi.UInt32(747796405) + mi.UInt32(2891336453)
    return x ^ (x >> 16)


def recursion(node: int, level: int) -> tuple[int, int]:
    """Sum over the nodes of a tree, and how many there are."""
    total, count = mixed(node), 1
    inner = level < DEPTH
    left, right = inner and node & 3 != 0, inner and (node & 7 != 4)
    for there, child in ((left, 1), (left or right, 2)):
        if there:
            more, nodes = recursion(mixed((2 * node + child) & WORD), level + 1)
            total, count = total + more, count + nodes
    return total & WORD, count


def loop(registers: bool, mode: Any, stack_class: type = Stack) -> tuple[Any, Any]:
    class Entry:
        DRJIT_STRUCT: ClassVar = {"node": mi.UInt32, "level": mi.UInt32}

        def __init__(self, node: Any = None, level: Any = None) -> None:
            self.node, self.level = node, level

    stack = stack_class(Entry(mi.UInt32(0), mi.UInt32(0)), DEPTH, mi.UInt32, registers)

    def body(node: Any, level: Any, active: Any, total: Any, count: Any, state: Any) -> Any:
        stack.state = state
        total = total + dr.select(active, mixed(node), 0)
        count = count + dr.select(active, mi.UInt32(1), 0)
        inner = active & (level < DEPTH)
        left = inner & ((node & 3) != 0)
        right = left | (inner & ((node & 7) != 4))
        stack.push(Entry(mixed(node * 2 + 1), level + 1), left)
        entry, popped = stack.pop(active & ~right)
        node = dr.select(right, mixed(node * 2 + 2), dr.select(popped, entry.node, node))
        level = dr.select(right, level + 1, dr.select(popped, entry.level, level))
        # the bug makes loops endless: a full tree has 2^(DEPTH + 1) nodes
        return node, level, (right | popped) & (count < 2 << DEPTH), total, count, stack.state

    start = mixed(dr.arange(mi.UInt32, LANES))
    state = (start, mi.UInt32(0), mi.Bool(True), mi.UInt32(0), mi.UInt32(0), stack.state)
    out = dr.while_loop(state, lambda node, level, active, *rest: active, body, mode=mode)
    dr.eval(out[3], out[4])
    return out[3].numpy(), out[4].numpy()


@pytest.mark.parametrize(("registers", "mode"), [(False, "symbolic"), (True, "symbolic"), (True, "evaluated")])
def test_tree(registers: bool, mode: str) -> None:
    """Every lane walks its whole tree, in each way of keeping the entries."""
    want = np.array([recursion(mixed(i), 0) for i in range(LANES)])
    total, count = loop(registers, mode)
    np.testing.assert_array_equal(count, want[:, 1])
    np.testing.assert_array_equal(total, want[:, 0])


class Masked(Stack):
    """As one would write it, and as it is wrong: local memory with masks."""

    def push(self, entry: Any, active: Any) -> None:
        height, entries = self.state
        local: Any = entries
        local.write(entry, height, active=active)
        self.state = (dr.select(active, height + 1, height), entries)

    def pop(self, active: Any) -> Any:
        height, entries = self.state
        taken = active & (height > 0)
        height = dr.select(taken, height - 1, height)
        local: Any = entries
        entry = local.read(height, active=taken)
        self.state = (height, entries)
        return entry, taken


@pytest.mark.xfail(reason="drjit 1.5.0: masked access to dr.Local in a symbolic loop is wrong on LLVM", strict=True)
def test_masked_access() -> None:
    """Once this passes, the dummy slot may go."""
    want = np.array([recursion(mixed(i), 0) for i in range(LANES)])
    total, _ = loop(False, "symbolic", Masked)
    np.testing.assert_array_equal(total, want[:, 0])


def test_full() -> None:
    stack = Stack(mi.UInt32(0), 1, mi.UInt32, registers=True)
    assert not dr.any(stack.full())
    stack.push(mi.UInt32(5), mi.Bool(True, False))
    assert list(stack.full()) == [True, False]
    entry, taken = stack.pop(mi.Bool(True, True))
    assert list(taken) == [True, False]
    assert entry[0] == 5
