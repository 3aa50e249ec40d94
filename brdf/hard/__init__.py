"""Hard cases: every formula against its exact answer, in units of what rounding its inputs may do.

`FORMULAS` are the bricks and the models under their choices, `grid` draws points where they are hard, `table` holds
exact answers there, and `criterion` says how many roundings each is off, in value and in every derivative.
"""

from .catalogue import FORMULAS, formulas_of
from .criterion import Verdict, judge
from .formulas import Formula, Limits
from .table import Exact, load

__all__ = ["FORMULAS", "Exact", "Formula", "Limits", "Verdict", "formulas_of", "judge", "load"]
