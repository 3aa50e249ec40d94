"""Other ways to compute what `brdf` does: the formulas as books print them, and Mitsuba's own."""
