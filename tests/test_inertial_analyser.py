"""The analyser against a closed form and against periodograms averaged by hand."""

import re

import numpy as np
import pytest

from glint_aoa.errors import InputError, RecordingError
from glint_aoa.inertial.analyser import averaged_spectra, frequency_responses
from glint_aoa.records.acquisition import AcquisitionRecord, Channel

RATE_HZ = 800.0
NATURAL_HZ, DAMPING = 9.8, 0.02


def a_record(**signals):
    channels = {
        name: Channel(name=name, samples=np.asarray(each), rate_hz=RATE_HZ, units="m/s^2")
        for name, each in signals.items()
    }
    return AcquisitionRecord("record", channels)


def resonance(frequency_hz):
    """Acceleration per unit of force of a single degree of freedom of unit mass."""
    return -(frequency_hz**2) / (
        NATURAL_HZ**2 - frequency_hz**2 + 2j * DAMPING * NATURAL_HZ * frequency_hz
    )


def answer(force):
    frequency = np.fft.rfftfreq(force.size, 1 / RATE_HZ)
    return np.fft.irfft(np.fft.rfft(force) * resonance(frequency), force.size)


def random_force(seed=1, duration_s=120.0):
    return np.random.default_rng(seed).standard_normal(round(duration_s * RATE_HZ))


def sweep(duration_s=64.0):
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    return np.sin(2 * np.pi * (5.0 + (60.0 - 5.0) * time / (2 * duration_s)) * time)


def by_hand(one, other, segment):
    """Cross density of Hann segments, half overlapped, means removed; written out."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(segment) / segment)
    starts = range(0, one.size - segment + 1, segment // 2)

    def spectra(signal):
        parts = np.array([signal[s : s + segment] for s in starts])
        return np.fft.rfft(window * (parts - parts.mean(axis=1, keepdims=True)), axis=1)

    cross = np.mean(spectra(one).conj() * spectra(other), axis=0)
    cross *= 2 / (RATE_HZ * np.sum(window**2))
    cross[[0, -1]] /= 2
    return cross


def test_spectra_and_coherence_are_those_averaged_by_hand():
    force = random_force(duration_s=20.0)
    noisy = answer(force) + np.random.default_rng(2).standard_normal(force.size)
    record = a_record(force=force, ay=noisy)
    got = frequency_responses(record, "force", ["ay"], segment_s=4.0)
    cross, drive, power = (
        by_hand(a, b, 3200) for a, b in ((force, noisy), (force,) * 2, (noisy,) * 2)
    )
    np.testing.assert_allclose(got.response[0], cross / drive, rtol=1e-9)
    np.testing.assert_allclose(
        got.coherence[0], np.abs(cross) ** 2 / (drive * power).real, rtol=1e-9
    )
    spectra = averaged_spectra(record, ["force", "ay"], segment_s=4.0)
    np.testing.assert_allclose(spectra.density, np.real([drive, power]), rtol=1e-9)
    np.testing.assert_array_equal(spectra.frequency_hz, got.frequency_hz)


@pytest.mark.parametrize("force", [random_force(), sweep()], ids=["random", "sine sweep"])
@pytest.mark.parametrize("estimator", ["H1", "H2"])
def test_a_resonance_is_found_where_it_is(force, estimator):
    record = a_record(force=force, ay=answer(force))
    got = frequency_responses(record, "force", ["ay"], estimator=estimator, segment_s=16.0)
    band = (got.frequency_hz > 7) & (got.frequency_hz < 30)
    expected = resonance(got.frequency_hz[band])
    error = np.abs(got.response[0, band] - expected) / np.abs(expected)
    assert np.median(error) < 0.01
    assert got.frequency_hz[band][np.argmax(np.abs(got.response[0, band]))] == pytest.approx(
        9.8, abs=0.07
    )
    assert np.median(got.coherence[0, band]) > 0.99


def test_noise_biases_h1_through_the_force_and_h2_through_the_answer():
    force, rng = random_force(), np.random.default_rng(3)
    noise = 0.5 * rng.standard_normal(force.size)
    flat = a_record(force=force, noisy_force=force + noise, ay=force, noisy_ay=force + noise)
    gains = {
        (reference, name, estimator): np.median(
            np.abs(frequency_responses(flat, reference, [name], estimator=estimator).response)
        )
        for reference, name in (("noisy_force", "ay"), ("force", "noisy_ay"))
        for estimator in ("H1", "H2")
    }
    assert gains["noisy_force", "ay", "H1"] == pytest.approx(1 / 1.25, rel=0.03)
    assert gains["noisy_force", "ay", "H2"] == pytest.approx(1.0, rel=0.03)
    assert gains["force", "noisy_ay", "H1"] == pytest.approx(1.0, rel=0.03)
    assert gains["force", "noisy_ay", "H2"] == pytest.approx(1.25, rel=0.03)


def test_the_standard_deviation_is_that_of_repeated_records():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(60):
        force = rng.standard_normal(round(16 * RATE_HZ))
        record = a_record(force=force, ay=force + rng.standard_normal(force.size))
        found.append(frequency_responses(record, "force", ["ay"], segment_s=1.0))
    scatter = np.std([np.abs(each.response[0, 5:-5]) for each in found], axis=0)
    told = np.mean([(each.relative_std * np.abs(each.response))[0, 5:-5] for each in found], axis=0)
    assert np.mean(scatter) == pytest.approx(np.mean(told), rel=0.05)


def test_a_reference_without_power_tells_nothing():
    record = a_record(force=np.zeros(16000), ay=random_force(duration_s=20.0))
    got = frequency_responses(record, "force", ["ay"])
    assert np.isnan(got.response).all()
    assert (got.coherence == 0).all()
    assert np.isinf(got.relative_std).all()


def test_scales_of_the_channels_are_applied():
    force = random_force(duration_s=20.0)
    record = a_record(force=force, ay=force)
    channels = {**record.channels, "ay": Channel("ay", force, RATE_HZ, scale=-2.5)}
    got = frequency_responses(AcquisitionRecord("record", channels), "force", ["ay"])
    np.testing.assert_allclose(got.response[0], -2.5, rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"estimator": "H3"}, InputError, "estimator is 'H3'; choose H1 or H2"),
        ({"segment_s": 0.0}, InputError, "segment_s is 0; give a length above zero [s]"),
        (
            {"segment_s": 8.0},
            RecordingError,
            "record: lasts 10 s, but coherence takes two segments of 8 s; record longer or "
            "shorten the segments",
        ),
    ],
)
def test_what_cannot_be_analysed_is_refused(options, error, message):
    record = a_record(force=np.ones(8000), ay=np.ones(8000))
    with pytest.raises(error, match=re.escape(message)):
        frequency_responses(record, "force", ["ay"], **options)


def test_channels_that_do_not_fit_are_refused():
    gap = np.ones(8000)
    gap[1600] = np.nan
    record = a_record(force=np.ones(8000), ay=np.ones(7999), az=gap)
    with pytest.raises(RecordingError, match=re.escape("channels force and ay differ in length")):
        frequency_responses(record, "force", ["ay"])
    message = "channel az has 1 samples that are not finite, the first at 2.000 s"
    with pytest.raises(RecordingError, match=re.escape(message)):
        averaged_spectra(record, ["az"])
    with pytest.raises(InputError, match=re.escape("no channels are named")):
        averaged_spectra(record, [])
