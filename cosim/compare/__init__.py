"""Two plants under the same commands: how far apart they are, as numbers and as a figure."""
