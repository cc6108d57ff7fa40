"""Kinds of vehicle: roles that a plant must offer so that a controller can drive it."""
