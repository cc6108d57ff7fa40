"""Columns: a compiled function that asks for vectors of four numbers has no wider ones."""

import re

import numba
import numpy as np
import pytest
from formation_controllers.columns import sin_cos_of
from formation_controllers.compiled import vectors_of_four

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def narrow(angle, sine, cosine, count):
    vectors_of_four()
    sin_cos_of(angle, sine, cosine, count)


def test_loops_keep_to_vectors_of_four():
    angle = np.linspace(-3.0, 3.0, 7)
    found = np.zeros((2, len(angle)))
    function = numba.njit(error_model="numpy")(narrow)
    function(angle, *found, len(angle))
    np.testing.assert_allclose(found, [np.sin(angle), np.cos(angle)], rtol=1e-15, atol=1e-16)
    (text,) = function.inspect_llvm().values()
    (attributes,) = re.findall(r'attributes #0 = {(.*"prefer-vector-width"="256".*)}', text)
    assert attributes
    assert not re.search(r"<(8|16) x double>", text), "the loop has vectors of eight numbers, or more"
