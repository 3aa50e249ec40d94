"""What the verbs share: results on standard output, progress on standard error."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

#: The option every verb has.
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

#: Columns of a table that goes to a file or a pipe: wide enough that nothing is folded.
WIDE = 1000


def print_json(result: Any) -> None:
    """Print `result` as JSON; infinite and undefined numbers must have been replaced by None."""
    print(json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False))


def print_table(table: Table) -> None:
    """Print `table` at the width of the terminal, or unfolded where there is none."""
    Console(width=None if sys.stdout.isatty() else WIDE).print(table)


def progress_bar(pace: float = 30.0) -> Progress:
    """A progress bar on standard error; silent unless that is a terminal.

    Parameters
    ----------
    pace : float
        The time left is estimated from what was done in so many seconds.
    """
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    return Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal, speed_estimate_period=pace
    )
