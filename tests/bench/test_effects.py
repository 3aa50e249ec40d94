"""`effects` against `path`, time at equal error: ``python -m pytest tests/bench/test_effects.py --benchmark-only -s``."""

from __future__ import annotations

from typing import Any

import pytest

from tests.bench import effects


@pytest.mark.parametrize("name", effects.RACES)
def test_time_at_equal_error(benchmark: Any, name: str) -> None:
    result = effects.race(name)
    benchmark.extra_info.update(time=result.time, error=result.error, equal_error=result.equal_error)
    benchmark.pedantic(lambda: None, rounds=1)  # ratios of one run, not its statistics
    print(f"\n{name}: {result.equal_error:.3f} of path's time at equal error")
    assert result.equal_error <= effects.RACES[name][2]
