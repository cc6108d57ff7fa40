"""Two plants under the same torques: how far apart they are, as numbers and as a figure."""
