"""From a model to an FMU.

`table` and `generate` make the text, `compile` the binary, `package` the zip, `store` keeps it; `build` joins them.
"""
