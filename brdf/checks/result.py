"""What a check found, and whether that is as the model declares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

#: Every check by name, in the order in which they are shown, and what it asks.
CHECKS = {
    "reciprocity": "is it the same with the two directions exchanged?",
    "energy": "does each lobe reflect no more than arrives, and does sampling find as much?",
    "coupling": "do all lobes together reflect no more than arrives?",
    "sampling": "are directions drawn as the density says?",
    "gradient": "is the derivative in each parameter that of the value?",
    "gradient_path": "is the derivative of a picture by `path` that of the picture?",
    "gradient_prb": "is the derivative of a picture by `prb` that of the picture?",
    "gradient_direct": "is the derivative of a picture by `direct` that of the picture?",
    "gradient_effects": "is the derivative of a picture by `effects` that of the picture?",
    "gradient_raytree": "is the derivative of a picture by `raytree` that of the picture?",
    "finite": "is everything finite and nothing negative, for hostile inputs?",
    "peak": "does the maximum of a glossy lobe leave the mirror direction at grazing incidence?",
}


@dataclass(frozen=True)
class Finding:
    """What a check found at one setting of the parameters. Make it with `at_most`, `at_least` or `not_asked`.

    Attributes
    ----------
    passed : bool
    figure, limit : float or None
        The worst found, and what is allowed; None where the question does not arise.
    badness : float
        Figure over limit, or limit over figure: the larger, the worse; above 1 it failed.
    reason : str
        One sentence; may be empty if it passed.
    case : dict
        Plain values from which it can be run again. ``case["figure"]`` says what the figure is.
    """

    passed: bool
    figure: float | None = None
    limit: float | None = None
    badness: float = 0.0
    reason: str = ""
    case: Mapping[str, Any] = field(default_factory=dict)


def at_most(figure: float, limit: float, reason: str, case: Mapping[str, Any]) -> Finding:
    """Passed if ``figure <= limit``; `reason` is said if not."""
    passed = figure <= limit
    badness = figure / limit if limit > 0 else 0.0 if passed else math.inf
    return Finding(passed, figure, limit, math.inf if math.isnan(badness) else badness, "" if passed else reason, case)


def at_least(figure: float, limit: float, reason: str, case: Mapping[str, Any]) -> Finding:
    """Passed if ``figure >= limit``; `reason` is said if not."""
    passed = figure >= limit
    badness = limit / figure if figure > 0 else math.inf
    return Finding(passed, figure, limit, math.inf if math.isnan(badness) else badness, "" if passed else reason, case)


def not_asked(reason: str, case: Mapping[str, Any] | None = None) -> Finding:
    """The question does not arise, for this reason."""
    return Finding(True, reason=reason, case=case or {})


def worst(findings: Sequence[Finding]) -> Finding:
    """The one that failed most, else the one that is nearest to failing, else one that was not asked."""
    return max(findings, key=lambda f: (not f.passed, f.figure is not None, f.badness))


def worst_parameter(findings: Sequence[Finding]) -> Finding:
    """As `worst`, of findings on one parameter each; ``case["also"]`` gives the figures of the others that failed."""
    found = worst(findings)
    also = {f.case["parameter"]: f.figure for f in findings if not f.passed and f is not found}
    if not also:
        return found
    reason = f"{found.reason} Also off: {', '.join(also)}."
    return replace(found, reason=reason, case={**found.case, "also": also})


@dataclass(frozen=True)
class Result:
    """The outcome of one check.

    Attributes
    ----------
    check : str
        Its name, a key of `CHECKS`.
    passed : bool
    expected : bool
        The outcome is as the model declares it: passed and no fault declared, or failed and a fault declared.
    figure, limit : float or None
        The worst found, and what is allowed.
    reason : str
        For a declared failure what the model says; else one sentence on what was found, if there is anything to say.
    case : dict
        Where the worst was found, in plain values: parameters, directions, what the figure is, and a ``command``.
    """

    check: str
    passed: bool
    expected: bool
    figure: float | None = None
    limit: float | None = None
    reason: str = ""
    case: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """One or two words: ``passed``, ``failed``, ``expected to fail``, ``unexpectedly passed``."""
        if self.passed:
            return "passed" if self.expected else "unexpectedly passed"
        return "expected to fail" if self.expected else "failed"

    def as_dict(self) -> dict[str, Any]:
        """For JSON: passed, expected, figure, limit, reason, case. What is not finite becomes None."""
        return {
            "passed": self.passed,
            "expected": self.expected,
            "figure": plain(self.figure),
            "limit": plain(self.limit),
            "reason": self.reason,
            "case": plain(self.case),
        }


def judge(check: str, findings: Sequence[Finding], declared: str = "", must_occur: bool = True) -> Result:
    """The worst of some findings, held against what the model declares.

    Parameters
    ----------
    check : str
    findings : sequence of Finding
        One for each setting that was tried.
    declared : str
        Why it is known to fail; empty if it is not.
    must_occur : bool
        Whether a declared failure that does not occur is itself unexpected: not if only some settings were tried.
    """
    found = worst(findings)
    case = dict(found.case)
    if found.passed:
        if declared and must_occur:
            reason = f"It is declared to fail ({declared}), and does not."
            return Result(check, True, False, found.figure, found.limit, reason, case)
        return Result(check, True, True, found.figure, found.limit, found.reason, case)
    if declared:
        case["found"] = found.reason
        return Result(check, False, True, found.figure, found.limit, declared, case)
    return Result(check, False, False, found.figure, found.limit, found.reason, case)


def plain(value: Any) -> Any:
    """`value` as JSON has it: lists, dictionaries, text, finite numbers, None."""
    if isinstance(value, Mapping):
        return {str(key): plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, str) else str(value)
