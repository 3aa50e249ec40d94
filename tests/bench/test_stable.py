"""What the stable forms cost beside those of the text book."""

from __future__ import annotations

from typing import Any

from tests.bench.price import CASES, RATIONAL, prices

#: In float32, of the value.
LIMIT = 1.15
#: What costs more, as measured with a margin: F of a metal, as the text book's, which is shorter, cancels next to 1 and at
#: Brewster's angle; Phong's lobe, which is little but a power: the stable one adds a distance and a division; and a layer,
#: whose plain form is 0/0 for equal cosines.
MORE = {
    "F, conductor": 1.5,
    "cooktorrance, conductor": 1.3,
    "phong": 1.4,
    "hanrahankrueger, reflected": 1.6,
    "hanrahankrueger, transmitted": 1.9,
}


def test_price(benchmark: Any) -> None:
    """In one run, in turns. What a renderer has in place of Smith's masking is not the same function, and not asked."""
    found = prices(CASES, ["float32"], [False], rounds=9)
    benchmark.pedantic(lambda: None, rounds=1)  # ratios of one run, not its statistics
    for x in found:
        bound = ", bound by memory" if x.memory_bound else ""
        print(f"{x.case}: {x.stable:.2f} ns, {x.ratio:.2f} times the text book's{bound}")
    assert not [(x.case, x.ratio) for x in found if x.case != RATIONAL and x.ratio > MORE.get(x.case, LIMIT)]
