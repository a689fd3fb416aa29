"""Figures of a point: what is drawn, in which units, and told apart without colour."""

import re
from functools import partial

import numpy as np
import pytest
from closed_form import mode, task

from glint_aoa.errors import RecordingError
from glint_aoa.flags import Flag
from glint_aoa.inertial.bias_coherence import bias_coherence
from glint_aoa.records.acquisition import AcquisitionRecord
from glint_aoa.report.cells import printed
from glint_aoa.report.point_figures import amplitude_spectrum, inertial_figure, optical_figure
from glint_aoa.setup import Inertial

RATE_HZ = 60.0
LABEL = re.compile(r".+ \[(?:deg|mm|s|Hz|1)\]")


def fields(n=60, *, rng=None, out=()):
    rng = rng or np.random.default_rng(3)
    flags = np.zeros(n, np.int64)
    flags[list(out)] = Flag.MOVED
    return {
        "time_s": np.arange(n) / RATE_HZ,
        "parity": np.arange(n) % 2,
        "angle_deg": rng.normal(4, 1e-3, n),
        "angle_std_deg": np.full(n, 1e-3),
        "intercept_mm": rng.normal(34, 2e-3, n),
        "intercept_std_mm": np.full(n, 2e-3),
        "flags": flags,
    }


def correction(n=40):
    time = np.arange(n) / 20
    flags = np.zeros(n, np.int64)
    flags[:8] = Flag.FILTER_SETTLING
    return {
        "time_s": time,
        "angle_deg": np.full(n, 4.0),
        "angle_std_deg": np.full(n, 1e-3),
        "raw_angle_deg": np.full(n, 3.9),
        "flags": flags,
    }


def shaken(rng, *, duration_s=60.0, noise=1e-4):
    """Record of a modulated mode in yaw, with noise in its output [m/s^2]."""
    made, _ = task(mode(1, "yaw", 9.8, 0.787), depth=0.5, duration_s=duration_s)
    aoa = made.record["aoa"]
    noisy = aoa.samples + rng.normal(0, noise, len(aoa))
    channels = {**made.record.channels, "aoa": type(aoa)(**{**vars(aoa), "samples": noisy})}
    return AcquisitionRecord(made.record.name, channels)


class TestSpectrum:
    @pytest.mark.parametrize("amplitude", [0.28, 0.001])
    def test_of_a_sine(self, amplitude):
        time = np.arange(60) / RATE_HZ
        sine = 4 + amplitude * np.sin(2 * np.pi * 9.0 * time + 0.3)
        found = amplitude_spectrum(sine, np.ones(60, bool), rate_hz=RATE_HZ, noise=1e-3)
        assert found.amplitude[found.frequency_hz == 9.0] == pytest.approx(amplitude, rel=1e-6)
        assert found.bridged == 0
        assert found.frequency_hz[0] == 1.0

    def test_between_two_bins_is_15_percent_low_at_most(self):
        time = np.arange(60) / RATE_HZ
        sine = np.sin(2 * np.pi * 9.5 * time)
        found = amplitude_spectrum(sine, np.ones(60, bool), rate_hz=RATE_HZ, noise=0.0)
        assert 0.84 < found.amplitude.max() < 0.87

    def test_noise_is_what_noise_gives(self):
        rng = np.random.default_rng(11)
        everything = np.ones(256, bool)
        spectrum = partial(amplitude_spectrum, good=everything, rate_hz=RATE_HZ, noise=2e-3)
        found = [spectrum(rng.normal(0, 2e-3, 256)) for _ in range(200)]
        inner = np.array([each.amplitude[3:-3] for each in found])
        assert np.sqrt(np.mean(inner**2)) == pytest.approx(found[0].noise, rel=0.02)

    def test_fields_that_do_not_count_are_bridged(self):
        values, good = np.zeros(60), np.ones(60, bool)
        values[20], good[20] = 100.0, False
        found = amplitude_spectrum(values, good, rate_hz=RATE_HZ, noise=1.0)
        assert found.bridged == 1
        assert found.amplitude.max() == 0

    def test_of_too_few_fields_there_is_none(self):
        good = np.arange(60) < 7
        assert amplitude_spectrum(np.zeros(60), good, rate_hz=RATE_HZ, noise=1.0) is None


class TestCoherence:
    def test_bias_follows_the_squared_velocity(self):
        found = bias_coherence(shaken(np.random.default_rng(1)), Inertial())
        spectra = found.spectra
        assert (found.plane, found.source) == ("yaw", "ay")
        for frequency in (0.3, 19.6):  # of the modulation, and twice the mode's
            near = np.abs(spectra.frequency_hz - frequency) < 0.06
            assert spectra.coherence[near].max() > 0.99

    def test_noise_does_not(self):
        record = shaken(np.random.default_rng(2), noise=10.0)
        spectra = bias_coherence(record, Inertial()).spectra
        beyond = np.mean(spectra.coherence[1:] > spectra.by_chance(0.05))
        assert beyond == pytest.approx(0.05, abs=0.02)

    def test_of_a_record_without_motion(self):
        made, _ = task(mode(1, "yaw", 9.8, 0.787))
        record = AcquisitionRecord("alone", {"aoa": made.record["aoa"]})
        with pytest.raises(RecordingError, match=re.escape(
            "alone: no accelerometer or balance channel of yaw or pitch on the package's clock; "
            "record one, or name it under [[inertial.channel]] in the setup"
        )):  # fmt: skip
            bias_coherence(record, Inertial())


def figures():
    yield optical_figure(
        fields(out=[5]),
        {"rate_hz": RATE_HZ, "vibration_frequency_hz": np.array([9.2, 20.3])},
        {"mean_angle_deg": "4.0", "mean_angle_u95_deg": "0.001"},
    )
    yield optical_figure(fields(n=5), {}, {})
    coherence = bias_coherence(shaken(np.random.default_rng(1), duration_s=12.0), Inertial())
    yield inertial_figure(correction(), coherence, optical=(0.0, 1.0, 4.0))
    yield inertial_figure(correction(), None)


@pytest.fixture(scope="module")
def drawn():
    return list(figures())


def test_axes_say_what_they_show_in_which_unit(drawn):
    for figure in drawn:
        for axes in figure.axes:
            assert LABEL.fullmatch(axes.get_ylabel())
            below = axes.get_subplotspec().is_last_row()
            assert bool(LABEL.fullmatch(axes.get_xlabel())) == below


def test_curves_are_told_apart_without_colour(drawn):
    for figure in drawn:
        for axes in figure.axes:
            lines = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
            looks = [(e.get_linestyle(), e.get_marker(), e.get_linewidth()) for e in lines]
            assert len(looks) == len(set(looks))


def test_fields_are_drawn_as_they_count(drawn):
    angle = drawn[0].axes[0]
    lines = {line.get_label(): line for line in angle.get_lines()}
    assert lines["left out"].get_xdata() == pytest.approx([5 / RATE_HZ])
    assert len(lines["even fields"].get_xdata()) == 30
    assert len(lines["odd fields"].get_xdata()) == 29
    assert lines["mean, 95 %"].get_ydata() == pytest.approx([4.0, 4.0])
    marks = [line.get_xdata()[0] for line in drawn[0].axes[1].get_lines()[2:]]
    assert marks == [9.2, 20.3]
    assert drawn[1].axes[1].texts[0].get_text() == "too few fields with angle"


def test_settling_of_the_low_pass_is_marked(drawn):
    (span,) = [p for p in drawn[3].axes[0].patches if p.get_label() == "low-pass settles"]
    assert span.get_x() + span.get_width() == pytest.approx(7 / 20)


@pytest.mark.parametrize(
    ("cell", "text"),
    [("0.00294", "+0.0029"), ("-0.00001", "+0.0000"), ("", ""), ("nan", ""), ("plain", "plain")],
)
def test_numbers_as_printed(cell, text):
    assert printed(cell, "+.4f") == text
