"""Quantities are read with their unit, or refused with the right spelling."""

import re

import pytest

from cosim.quantity import quantity, split


def test_a_quantity_in_another_unit() -> None:
    assert quantity("350 mm", "m") == 350 * 1e-3
    assert quantity(" 3m ", "m") == 3.0
    assert split("2.5e-1 N.m") == (0.25, "N.m")


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("3,5 m", "write '3.5 m' (decimals follow a point)"),
        ("3,5m", "write '3.5 m' (decimals follow a point)"),
        ("−3.5 m", "write '-3.5 m' (a minus sign is a hyphen)"),
        ("–3,5 m", "write '-3.5 m' (decimals follow a point)"),
        ("1,000 m", "decimals follow a point, and nothing separates thousands"),
        ("1.000,5 m", "decimals follow a point, and nothing separates thousands"),
        ("1 000 m", "write '1000 m'"),
        ("1'000'000.5 m", "write '1000000.5 m'"),
        ("3.5\N{NO-BREAK SPACE}m", "write '3.5 m'"),
        ("3.5 metres", "write '3.5 m'"),
        ("45°", "write '45 deg'"),
        ("200Nm", "write '200 N.m'"),
    ],
)
def test_what_is_written_otherwise_elsewhere(text: str, advice: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"{text!r} is not a number with a unit: {advice}") + "$"):
        quantity(text, "m")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "'' is not a number with a unit, such as '1 m'"),
        ("m 3", "'m 3' is not a number with a unit, such as '1 m'"),
        ("3.5", "'3.5': the unit is missing; expected a quantity such as '3.5 m'"),
        ("3 kg", "'3 kg': kg does not fit"),
        ("1e400 m", "is not a finite number"),
        ("3 furlong", "'furlong' is not known"),
    ],
)
def test_what_is_wrong(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        quantity(text, "m")


def test_a_text_that_is_no_number_is_not_split() -> None:
    with pytest.raises(ValueError, match=re.escape("'30,5 m' is not a number with a unit: write '30.5 m'")):
        split("30,5 m")
