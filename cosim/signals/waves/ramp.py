"""Zero before a time, then rising evenly to a value that it keeps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.signals.waves.wave import Sampling, Wave


class Ramp(Wave):
    """``<ramp>``."""

    element = "ramp"

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the values."""
        start, stop = self.written.start, self.written.stop
        return self.amount(sampling) * np.clip((sampling.times - start) / (stop - start), 0.0, 1.0)
