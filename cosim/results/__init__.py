"""Results of a run: what is kept of it, its figures, whether it did what was expected, and its files."""
