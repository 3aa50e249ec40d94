"""Ratios of running times: measured in one run, interleaved, medians of several."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any


def interleaved(benchmark: Any, ours: Callable[[], Any], theirs: Callable[[], Any], rounds: int) -> float:
    """Median time of `ours` by that of `theirs`, in turns; what `ours` takes goes into the table of pytest-benchmark.

    Both are called twice first, so that what is compiled is compiled.
    """
    times: dict[str, list[float]] = {"ours": [], "theirs": []}
    for i in range(-2, rounds):
        for name, function in (("ours", ours), ("theirs", theirs)):
            start = time.perf_counter()
            function()
            if i >= 0:
                times[name].append(time.perf_counter() - start)
    ratio = statistics.median(times["ours"]) / statistics.median(times["theirs"])
    benchmark.extra_info["ratio"] = ratio
    benchmark.extra_info["theirs_median"] = statistics.median(times["theirs"])
    benchmark.pedantic(ours, rounds=3)
    print(f"\n{benchmark.name}: {ratio:.2f} times Mitsuba's, medians of {rounds} rounds in turns")
    return ratio
