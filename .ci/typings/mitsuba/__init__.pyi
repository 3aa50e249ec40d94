# Mitsuba's own stubs describe one variant, and take its Float and Bool for types other than Dr.Jit's of the same name.
from typing import Any

def __getattr__(name: str) -> Any: ...
