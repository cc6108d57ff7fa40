"""Unit expressions."""

import math
import re

import numpy as np
import pytest

from plants import UnitError, units


@pytest.mark.parametrize(
    ("text", "exponents", "factor"),
    [
        ("1", {}, 1),
        ("m", {"m": 1}, 1),
        ("kg.m2", {"kg": 1, "m": 2}, 1),
        ("N.m", {"kg": 1, "m": 2, "s": -2}, 1),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1),
        ("N/(m.s2)", {"kg": 1, "s": -4}, 1),
        ("1/s", {"s": -1}, 1),
        ("s-2", {"s": -2}, 1),
        ("deg", {"rad": 1}, math.pi / 180),
        ("mm", {"m": 1}, 1e-3),
        ("mrad", {"rad": 1}, 1e-3),
        ("ms", {"s": 1}, 1e-3),
        ("min", {"s": 1}, 60),
        ("cd", {"cd": 1}, 1),
        ("g", {"kg": 1}, 1e-3),
        ("kN", {"kg": 1, "m": 1, "s": -2}, 1e3),
        ("km/h", {"m": 1, "s": -1}, 1 / 3.6),
        ("mm2", {"m": 2}, 1e-6),
    ],
)
def test_parse(text: str, exponents: dict[str, int], factor: float) -> None:
    unit = units.parse(text)
    assert {n: e for n, e in zip(units.BASE_UNITS, unit.exponents, strict=True) if e} == exponents
    assert unit.factor == pytest.approx(factor, rel=1e-15)


def test_convert() -> None:
    assert units.convert(180.0, "deg", "rad") == math.pi
    assert units.convert(36.0, "km/h", "m/s") == pytest.approx(10.0, rel=1e-15)
    np.testing.assert_allclose(units.convert(np.array([1.0, 2.0]), "m", "mm"), [1000.0, 2000.0])
    value = 0.1 + 0.2
    assert units.convert(value, "N.m", "J") is value


@pytest.mark.parametrize(
    "text", ["", "m//s", "m/s/s", "kg.", "1/kg.m", "m^2", "m s", "2m", "10", "m/10", "N/1", "1.m", "m0", "1-3"]
)
def test_what_is_not_an_expression(text: str) -> None:
    with pytest.raises(UnitError, match="unit '"):
        units.parse(text)


@pytest.mark.parametrize("text", ["kg/(nK9.nK9.nK9.nK9)", "nK9.nK9.nK9.nK9", "1/(GK9.GK9.GK9.GK9)", "GK9.GK9.GK9.GK9"])
def test_a_factor_that_no_number_can_be(text: str) -> None:
    with pytest.raises(UnitError, match=re.escape(f"unit {text!r}: its factor to the base units is not a number")):
        units.parse(text)


def test_unknown_symbol_is_named() -> None:
    with pytest.raises(UnitError, match=r"unit 'N.furlong': 'furlong' is not known; known are"):
        units.parse("N.furlong")


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("Nm", "N.m"),
        ("kNm/rad", "kN.m/rad"),
        ("N m", "N.m"),
        ("N*m*s / rad", "N.m.s/rad"),
        ("N·m", "N.m"),
        ("°", "deg"),
        ("º/s", "deg/s"),
        ("Deg", "deg"),
        ("degrees", "deg"),
        ("m/s^2", "m/s2"),
        ("m/s²", "m/s2"),
        ("m s⁻²", "m.s-2"),
        ("kg m^2", "kg.m2"),
        ("1/kg.m", "1/(kg.m)"),
        ("Kg", "kg"),
        ("hz", "Hz"),
        ("metres", "m"),
        ("µm", "um"),
        ("rpm", "rev/min"),
        ("Ω", "Ohm"),
    ],
)
def test_other_spellings_are_refused_with_ours(text: str, meant: str) -> None:
    with pytest.raises(UnitError, match=re.escape(f"unit {text!r}: write {meant!r}")):
        units.parse(text)


@pytest.mark.parametrize("text", ["Grad", "Grad/s", "1/Grad"])
def test_a_word_is_not_read_as_a_prefix_and_a_symbol(text: str) -> None:
    """Grad is German for degree, and would be 1e9 rad."""
    with pytest.raises(UnitError, match=re.escape(f"unit {text!r}: 'Grad' is not known: write 'deg'")):
        units.parse(text)


@pytest.mark.parametrize("text", ["T", "Nms", "grad", "2m", ",5 kg", "x" * 1000 + "^", "m" + " " * 1000 + "s"])
def test_what_is_not_clear_is_not_guessed(text: str) -> None:
    assert units.guess(text) == ""


@pytest.mark.parametrize(("source", "target"), [("m", "s"), ("rad/s", "Hz"), ("N", "N.m")])
def test_different_quantities_are_not_converted(source: str, target: str) -> None:
    with pytest.raises(UnitError, match=f"cannot convert '{source}' to '{target}'"):
        units.convert(1.0, source, target)


@pytest.mark.parametrize(
    ("unit", "rate"),
    [("m", "m/s"), ("m/s", "m/s2"), ("N.m/rad", "N.m/(rad.s)"), ("N/(m.s)", "N/(m.s.s)"), ("deg", "deg/s")],
)
def test_per_second(unit: str, rate: str) -> None:
    assert units.per_second(unit) == rate
    assert units.parse(rate) == units.parse(unit) / units.parse("s")


@pytest.mark.parametrize("text", ["1", "kg.m2", "N", "N.m", "1/s", "kg/(m.s2)", "kg2.m2", "m/s2"])
def test_dimensions_are_written_as_they_are_read(text: str) -> None:
    assert str(units.parse(text)) == text
