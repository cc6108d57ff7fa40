"""A kinematic bicycle with speed and steering-angle commands.

`model` is its plant, `vehicle` states the facts that controllers are told, `kind` those that the harness needs.
`law` is a formation controller for it.
``python -m kinematic_bicycle`` makes the plant's FMU.
"""
