"""The report of a fit: one self-contained page, and a shorter form for notebooks."""

from __future__ import annotations

import os

from ..files import replacing
from ..solution import Solution
from .page import fragment, html

__all__ = ["fragment", "write"]


def write(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Write the report to `path`, one HTML file that needs no other.

    Raises
    ------
    DataError
        The folder is missing or cannot be written.
    """
    text = html(solution)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
