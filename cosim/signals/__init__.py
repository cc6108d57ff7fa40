"""Signals over time: where robots are to be, and what sensors, actuators and disturbances do."""
