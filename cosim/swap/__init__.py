"""Bringing in a foreign FMU: its names, proposals of a binding, and variants that use it."""
