import contextlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glint_aoa.flags import REJECTING, Flag, describe
from glint_aoa.units import STANDARD_GRAVITY, conversion, convert, parse_quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("56 in", "m", 1.4224),
        ("1 ms", "s", 1e-3),
        ("180 deg", "rad", 3.141592653589793),
        ("1 g_0", "m/s^2", STANDARD_GRAVITY),
        ("5000 in*lbf", "N*m", 564.9241451),
        (3, "", 3.0),
    ],
)
def test_quantities(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-9)


def test_conversion_of_moments():
    assert convert("in*lbf", "N*m") == pytest.approx(0.1129848290276167, rel=1e-12)
    with pytest.raises(ValueError, match=re.escape("'m' cannot be turned into 's'")):
        convert("m", "s")


@pytest.mark.parametrize(
    ("unit", "reading", "kelvin"), [("degC", 36.85, 310.0), ("degF", 98.33, 310.0), ("K", 4.0, 4.0)]
)
def test_temperatures_have_a_zero_of_their_own(unit, reading, kelvin):
    factor, offset = conversion(unit, "K")
    assert factor * reading + offset == pytest.approx(kelvin, abs=1e-9)


def test_a_factor_alone_turns_no_celsius_into_kelvins():
    assert convert("degC", "degC") == 1.0
    with pytest.raises(ValueError, match="'degC' and 'K' differ in their zeros"):
        convert("degC", "K")


@given(st.text(max_size=12))
def test_no_text_breaks_the_parser(text):
    with contextlib.suppress(ValueError):
        assert isinstance(parse_quantity(text, "m"), float)


@given(st.integers(0, 2 * max(Flag) - 1))
def test_every_mask_is_described_bit_by_bit(mask):
    words = describe(mask)
    assert len(words) == mask.bit_count()
    assert all(": " in line for line in words)


def test_flags_are_distinct_bits_and_described():
    assert describe(0) == []
    assert [int(flag) for flag in Flag] == [1 << k for k in range(len(Flag))]
    assert describe(Flag.NO_GLINT) == ["NO_GLINT: no glint was found; nothing was measured"]
    assert REJECTING & Flag.NO_GLINT
    assert not REJECTING & Flag.UNCALIBRATED
