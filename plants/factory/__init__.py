"""From a model to an FMU.

`table`, `jacobian`, `document` and `generate` make its files, `platforms` and `compile` the binaries, `package` the
zip, `store` keeps it; `build` joins them.
"""
