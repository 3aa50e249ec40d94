"""The lecture's table of effects: which light meets which surface, and integrators that simulate what is called for."""
