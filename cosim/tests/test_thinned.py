"""Lines of many samples that are drawn with few show the same picture."""

import numpy as np
import pytest

from cosim.results.thinned import COLUMNS, thinned


@pytest.mark.parametrize("samples", [0, 1, 3 * COLUMNS, 4 * COLUMNS - 1])
def test_a_line_of_few_samples_is_drawn_whole(samples: int) -> None:
    assert thinned(np.zeros(samples)).tolist() == list(range(samples))


@pytest.mark.parametrize("samples", [4 * COLUMNS, 50 * COLUMNS, 12_345, 98_765])
def test_every_column_keeps_its_extremes_and_its_gaps(samples: int) -> None:
    random = np.random.default_rng(samples)
    values = random.standard_normal(samples)
    values[random.random(samples) < 0.02] = np.nan
    values[: samples // 10] = np.nan
    chosen = thinned(values)
    assert np.array_equal(chosen, np.unique(chosen))
    assert chosen[0] == 0
    assert chosen[-1] == samples - 1
    width = samples // COLUMNS
    assert len(chosen) <= 3 * COLUMNS + 3 * width + 4
    for start in range(0, samples, width):
        column = values[start : start + width]
        kept = values[chosen[(chosen >= start) & (chosen < start + width)]]
        assert np.isnan(kept).any() == np.isnan(column).any()
        if not np.isnan(column).all():
            assert np.nanmin(kept) == np.nanmin(column)
            assert np.nanmax(kept) == np.nanmax(column)
