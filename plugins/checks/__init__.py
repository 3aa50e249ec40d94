"""Questions asked of any BSDF in Mitsuba: ours, Mitsuba's own, anybody's."""
