"""The colours by which pictures of a run tell followers apart; the page has the same."""

from __future__ import annotations

COLOURS = ("#4477AA", "#EE6677", "#228833", "#B8860B", "#2AA7C9", "#AA3377", "#E07B39", "#7A68C4")
"""Of the first followers: the colour-blind can tell these."""
GOOD, BAD = "#1a7f37", "#c4232c"
"""Where values belong, and where not."""
