import re

import pytest

from glint_aoa.errors import InputError
from glint_aoa.inertial.modes import TABLE_1, Mode, modes_from_setup
from glint_aoa.setup import Inertial


def a_mode(number, frequency, plane="yaw"):
    return {"number": number, "plane": plane, "frequency": f"{frequency} Hz", "radius": "31 in"}


def test_table_1_is_the_papers():
    inches = {mode.number: mode.radius_m / 0.0254 for mode in TABLE_1}
    expected = {1: 31.0, 2: 30.2, 3: 0.18, 4: -1.08, 5: -7.14, 6: -7.65}
    assert inches == pytest.approx(expected)
    assert [mode.plane for mode in TABLE_1] == ["yaw", "pitch"] * 3
    assert [mode.frequency_hz for mode in TABLE_1] == [9.8, 9.2, 19.5, 20.3, 29.8, 34.2]


def test_modes_of_the_setup_come_in_order_of_frequency():
    inertial = Inertial.model_validate({"mode": [a_mode(5, 29.8), a_mode(1, 9.8)]})
    assert modes_from_setup(inertial) == (
        Mode(1, "yaw", 9.8, pytest.approx(0.7874)),
        Mode(5, "yaw", 29.8, pytest.approx(0.7874)),
    )


def test_no_modes_are_no_modes():
    assert modes_from_setup(Inertial()) == ()


def test_a_number_listed_twice_is_refused():
    inertial = Inertial.model_validate({"mode": [a_mode(1, 9.8), a_mode(1, 19.5)]})
    message = "inertial.mode: number 1 is listed twice; number modes apart"
    with pytest.raises(InputError, match=re.escape(message)):
        modes_from_setup(inertial)
