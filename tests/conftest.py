"""Before any test imports Dr.Jit or Mitsuba, brdf chooses their libLLVM; and how many examples hypothesis tries.

``HYPOTHESIS_PROFILE`` chooses: `dev` tries other examples every time, `ci` the same ones (the default where CI is set),
`deep` ten times as many, as the slow tests do in any case.
"""

import os

from hypothesis import settings

import brdf  # noqa: F401

# The first example of a kind compiles its kernel: no deadline.
settings.register_profile("dev", max_examples=100, deadline=None)
settings.register_profile("ci", settings.get_profile("dev"), derandomize=True, database=None)
settings.register_profile("deep", settings.get_profile("dev"), max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") else "dev"))
