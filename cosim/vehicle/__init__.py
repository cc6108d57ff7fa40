"""Kinds of vehicle: what a plant must offer so that a controller can drive it."""
