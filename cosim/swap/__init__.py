"""Bringing in a foreign FMU: what its names say, proposals of a binding, and variants that use it."""
