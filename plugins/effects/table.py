"""The cells of the lecture's table."""

ROWS = ("diffuse", "glossy", "mirror")
COLUMNS = ("point", "area", "environment", "indirect")
#: In the order of the table; `emitter` is a lamp or the sky seen directly. `mirror.point` is always black.
CELLS = (*(f"{row}.{column}" for row in ROWS for column in COLUMNS), "emitter")
