"""Quantities with units, parsed with pint and held as plain SI floats."""

from functools import cache
from typing import Any

__all__ = ["STANDARD_GRAVITY", "conversion", "convert", "parse_quantity"]

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (CODATA, exact); pint calls it ``g_0``."""


@cache
def _registry() -> Any:
    import pint  # noqa: PLC0415  slow to import, and only setup files and channels need it

    return pint.UnitRegistry(cache_folder=None)


def parse_quantity(text: str | float, unit: str) -> float:
    """Read a quantity such as ``"56 in"`` and return its value in `unit`.

    Parameters
    ----------
    text : str or float
        The quantity with its unit. A bare number is accepted only where `unit` is
        dimensionless (``""``).
    unit : str
        Unit of the result, as pint names it.

    Returns
    -------
    float
        The value [`unit`].

    Raises
    ------
    ValueError
        If `text` is not a quantity, or its dimension is not that of `unit`.
    """
    import pint  # noqa: PLC0415

    ureg = _registry()
    expected = unit or "a plain number"
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise ValueError(  # noqa: TRY004  pydantic turns it into a message about the key
            f"{text!r} is not a quantity; write a number with a unit of {expected}"
        )
    if isinstance(text, int | float):
        if unit:
            raise ValueError(f'{text!r} has no unit; write it as a string, e.g. "{text} {unit}"')
        return float(text)
    try:
        quantity = ureg.Quantity(text)
        value = quantity.to(unit).magnitude if unit else quantity.to("").magnitude
        return float(value)
    except pint.DimensionalityError:
        raise ValueError(f"{text!r} is not a quantity in {expected}") from None
    except (pint.PintError, ValueError, TypeError, AttributeError, SyntaxError, ArithmeticError):
        raise ValueError(
            f"{text!r} is not a quantity that can be read; expected {expected}"
        ) from None
    except Exception as error:  # pint's tokenizer leaks whatever Python's tokenizer raises
        raise ValueError(f"{text!r} is not a quantity that can be read ({error})") from None


def convert(from_unit: str, to_unit: str) -> float:
    """Return the factor that turns a value in `from_unit` into one in `to_unit`.

    Raises
    ------
    ValueError
        If a unit is unknown, the two measure different things, or their zeros differ (degC, K).
    """
    factor, offset = conversion(from_unit, to_unit)
    if offset:
        raise ValueError(f"{from_unit!r} and {to_unit!r} differ in their zeros")
    return factor


@cache
def conversion(from_unit: str, to_unit: str) -> tuple[float, float]:
    """Return how to turn a value in `from_unit` into one in `to_unit`.

    Returns
    -------
    factor : float
        What to multiply the value by.
    offset : float
        What to add then [`to_unit`]; zero but for temperatures.

    Raises
    ------
    ValueError
        If a unit is unknown or the two measure different things.
    """
    import pint  # noqa: PLC0415

    ureg = _registry()
    try:
        zero, one = (
            float(ureg.Quantity(each, from_unit).to(to_unit).magnitude) for each in (0.0, 1.0)
        )
    except pint.DimensionalityError:
        raise ValueError(f"{from_unit!r} cannot be turned into {to_unit!r}") from None
    except Exception:
        raise ValueError(f"{from_unit!r} is not a unit that is known here") from None
    return one - zero, zero
