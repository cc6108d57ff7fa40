"""Signals over time: desired places, and effects of sensors, actuators and disturbances."""
