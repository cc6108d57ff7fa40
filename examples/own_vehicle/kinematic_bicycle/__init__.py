"""A kinematic bicycle with speed and steering-angle commands: `model` is its plant.

``python -m kinematic_bicycle`` makes the plant's FMU.
"""
