"""Before any test imports Dr.Jit or Mitsuba, brdf chooses their libLLVM."""

import brdf  # noqa: F401
