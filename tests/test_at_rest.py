"""Recorded points as points of a sweep, and a sweep applied to recorded points."""

import re

import numpy as np
import pytest
from synthetic import line_fields

from calibration.sweep.fit import SweepPoint, SweepSetup, fit_sweep_points
from glint_aoa.at_rest import measure_at_rest
from glint_aoa.campaign import calibrate_sweep, check_sweep
from glint_aoa.errors import CalibrationError, RecordingError
from glint_aoa.flags import Flag
from glint_aoa.process import measure_point, process_point
from glint_aoa.records.acquisition import AcquisitionRecord, Channel
from glint_aoa.records.fields import FieldInfo
from glint_aoa.records.formats import open_fields
from glint_aoa.records.points import RecordedPoint, write_point
from glint_aoa.records.temperature import tunnel_temperature
from glint_aoa.setup import load_setup

CAMERA = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [99.5, 118]
position = ["0 m", "-56 in", "0 mm"]
"""
MODE = """
[[inertial.mode]]
number = 1
plane = "yaw"
frequency = "9.8 Hz"
radius = "31 in"
"""
RATE_HZ, SECONDS, RADIUS_M, PULSE = 200.0, 16.0, 31 * 0.0254, 2 * np.pi * 9.8
ROW = 20.0


def channels(rng, angle_deg, shake=0.0, *, accelerometer=True):
    """A package and an accelerometer on a model that yaws about a point 31 in behind them."""
    time_s = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    yaw_rate = shake * PULSE * np.cos(PULSE * time_s)
    aoa = np.sin(np.radians(angle_deg)) - RADIUS_M * yaw_rate**2 / 9.80665
    ay = -RADIUS_M * shake * PULSE**2 * np.sin(PULSE * time_s)
    package = Channel(
        "aoa", aoa + rng.normal(0, 1e-5, time_s.size), RATE_HZ, quantity="aoa_unfiltered",
        units="g_0",
    )  # fmt: skip
    face = Channel(
        "ay_face", ay + rng.normal(0, 1e-3, time_s.size), RATE_HZ, quantity="acceleration",
        units="m/s^2", station_m=0.9, axis="+y",
    )  # fmt: skip
    kept = (package, face) if accelerometer else (package,)
    return AcquisitionRecord("das", {each.name: each for each in kept})


def record(
    path, angle_deg, *, onboard_deg=None, row=ROW, mark=None, meta=None, seed=0, hour=8, **das
):
    rng = np.random.default_rng(seed)
    slope = np.tan(np.radians(angle_deg)) * 11.7 / 27.5
    fields = line_fields(rng, n_fields=8, shape=(40, 200), row=row, slope=slope)
    if mark is not None:
        fields[:, : round(mark), 5:25] = 200
        fields[:, round(mark) : 6, 5:25] = 40
    info = FieldInfo(
        rate_hz=60.0, exposure_s=1e-3, first_line=98, interlaced=False,
        trigger_time=f"2026-01-12T{hour:02d}:{seed:02d}:00",
    )  # fmt: skip
    write_point(
        path,
        RecordedPoint(
            fields=fields,
            info=info,
            acquisition=channels(rng, angle_deg if onboard_deg is None else onboard_deg, **das),
            meta={"run": "r", "point": path.stem, "tunnel_temperature_K": 294.0, **(meta or {})},
        ),
    )
    return path


@pytest.fixture
def setup_of(tmp_path):
    def load(text="", *, mode=MODE):
        path = tmp_path / "glint-aoa.toml"
        path.write_text(CAMERA + mode + text)
        return load_setup(path)

    return load


@pytest.fixture(scope="module")
def sweep_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return [
        record(folder / f"s{number}.h5", angle, seed=number)
        for number, angle in enumerate((-3.0, -1.5, 0.0, 1.5, 3.0))
    ]


@pytest.fixture(scope="module")
def sweep(sweep_files):
    path = sweep_files[0].with_name("glint-aoa.toml")
    path.write_text(CAMERA + MODE)
    return calibrate_sweep(sweep_files, load_setup(path))


class TestMeasure:
    def test_all_that_is_known_of_a_point(self, tmp_path, setup_of):
        path = record(tmp_path / "p.h5", 2.0, meta={"nominal_angle_deg": 2.01})
        point, made_with = measure_at_rest(path, setup_of())
        assert point.name == "p"
        assert abs(point.optical_deg - 2.0) < 3 * point.optical_std_deg < 0.015
        assert point.onboard_deg == pytest.approx(2.0, abs=1e-4)
        assert point.onboard_note == ""
        assert (point.time, point.temperature_k) == ("2026-01-12T08:00:00", 294.0)
        assert point.nominal_deg == 2.01
        assert point.line_v == pytest.approx(98 + ROW, abs=0.02)
        line_mm = 27.5e-6 * 1.4224 / 0.035 * 1e3
        assert point.intercept_mm == pytest.approx(-(98 + ROW - 118) * line_mm, abs=0.02)
        assert 0 < point.intercept_std_mm < 0.01
        assert point.mark_row is None
        assert made_with == SweepSetup.of(setup_of(), columns=made_with.columns)
        assert made_with.columns == (10.0, 190.0)

    def test_the_bias_of_vibration_is_taken_out(self, tmp_path, setup_of):
        path = record(tmp_path / "p.h5", 1.0, shake=0.002)
        point = measure_at_rest(path, setup_of()).point
        bias = -np.degrees(RADIUS_M * (0.002 * PULSE) ** 2 / 2 / 9.80665)
        assert bias < -0.03
        assert abs(point.onboard_deg - 1.0) < 3 * point.onboard_std_deg < 0.01
        said = re.fullmatch(
            r"a bias of (-[\d.]+) deg by vibration was taken out \(modal\)", point.onboard_note
        )
        assert float(said[1]) == pytest.approx(bias, abs=0.001)

    def test_where_that_cannot_be_done_it_is_said(self, tmp_path, setup_of):
        path = record(tmp_path / "p.h5", 1.0, shake=0.002, accelerometer=False)
        point = measure_at_rest(path, setup_of(mode="")).point
        assert point.onboard_deg < 0.97
        assert re.fullmatch(
            r"it shakes by 0\.0\d\d deg rms and cannot be corrected for that", point.onboard_note
        )

    def test_a_mark_is_found_where_it_is(self, tmp_path, setup_of):
        reference = "[glint.reference]\nrows = [0, 6]\ncolumns = [0, 30]\nrow = 1.0\n"
        path = record(tmp_path / "p.h5", 0.0, row=25.0, mark=3)
        point = measure_at_rest(path, setup_of(reference)).point
        assert point.mark_row == pytest.approx(98 + 2.5, abs=0.01)
        assert point.mark_column == pytest.approx((4.5 + 24.5) / 2, abs=0.05)
        assert point.mark_at == (98 + 2.5, 14.5)

    def test_no_glint(self, tmp_path, setup_of):
        path = record(tmp_path / "p.h5", 0.0, row=-50.0)
        with pytest.raises(CalibrationError, match=r"p\.h5: no field could be measured; leave"):
            measure_at_rest(path, setup_of())


class TestTunnelTemperature:
    @pytest.mark.parametrize(
        ("meta", "kelvin"),
        [
            ({"tunnel_temperature_K": 294}, 294.0),
            ({"tunnel_temperature": "21 degC"}, 294.15),
            ({"tunnel_temperature": "70 degF"}, 294.261),
            ({"run": "1"}, None),
        ],
    )
    def test_of_the_description(self, meta, kelvin):
        found = tunnel_temperature("p", meta)
        assert found is None if kelvin is None else found == pytest.approx(kelvin, abs=1e-3)

    @pytest.mark.parametrize(
        ("meta", "said"),
        [
            ({"tunnel_temperature_K": "warm"}, "/meta tunnel_temperature_K is 'warm'"),
            ({"tunnel_temperature_K": float("nan")}, "/meta tunnel_temperature_K is nan"),
            ({"tunnel_temperature": "21"}, "/meta tunnel_temperature is '21'"),
            ({"tunnel_temperature": "5 m"}, "/meta tunnel_temperature is '5 m'"),
        ],
    )
    def test_what_is_none_is_refused(self, meta, said):
        message = (
            f"p: {said}; give tunnel_temperature_K as a number, or tunnel_temperature with its "
            'unit such as "294 K"'
        )
        with pytest.raises(RecordingError, match=f"^{re.escape(message)}$"):
            tunnel_temperature("p", meta)

    def test_else_of_a_channel_that_is_the_tunnels(self):
        package = Channel("package", np.full(4, 344.0), 1.0, quantity="temperature", units="K")
        tunnel = Channel("tunnel_air", np.array([20.0, 22]), 1.0, quantity="temperature",
                         units="degC")  # fmt: skip
        both = AcquisitionRecord("r", {"package": package, "tunnel_air": tunnel})
        assert tunnel_temperature("p", {}, both) == pytest.approx(294.15)
        assert tunnel_temperature("p", {}, AcquisitionRecord("r", {"package": package})) is None


class TestApplied:
    def test_a_sweep_holds_what_its_points_say(self, sweep, sweep_files, setup_of):
        setup = setup_of()
        assert sweep.temperature_range_k == (294.0, 294.0)
        assert sweep.line_range == pytest.approx((98 + ROW, 98 + ROW), abs=0.05)
        assert sweep.setup == SweepSetup.of(setup, columns=(10.0, 190.0))
        assert sweep.provenance.date == "2026-01-12T08:00:00"
        assert sweep.provenance.files == tuple(path.name for path in sweep_files)
        assert [point.name for point in sweep.points] == [path.stem for path in sweep_files]

    @pytest.mark.parametrize(
        ("changes", "doubt"),
        [
            ({}, ""),
            (
                {"row": ROW + 3},
                r"the line's place is 121\.0 field lines in 8 of 8, 118\.0 in the sweep",
            ),
            ({"row": ROW + 2}, ""),
            (
                {"meta": {"tunnel_temperature_K": 301.0}},
                r"the tunnel temperature is 301\.0 K, 294\.0 K in the sweep",
            ),
            (
                {"angle_deg": 4.5},
                r"the optical angle is 4\.49 to 4\.51 deg in 8 of 8, -3\.00 to 3\.00 in the sweep",
            ),
        ],
        ids=["inside", "line", "line, just inside", "temperature", "angle"],
    )
    def test_outside_of_anything_is_flagged_and_said(
        self, sweep, setup_of, tmp_path, changes, doubt
    ):
        path = record(tmp_path / "p.h5", **{"angle_deg": 1.0, "seed": 9, **changes})
        result = measure_point(open_fields(path), setup_of(), sweep=sweep)
        assert re.fullmatch(doubt, result.record.attrs["calibration_doubts"])
        assert bool(result.flags & Flag.OUTSIDE_CALIBRATION) is bool(doubt)

    def test_another_estimator_is_flagged(self, sweep, sweep_files, setup_of):
        other = setup_of('[glint]\nestimator = "centroid"\n')
        result = measure_point(open_fields(sweep_files[2]), other, sweep=sweep)
        assert result.flags & Flag.OUTSIDE_CALIBRATION
        assert result.record.attrs["calibration_doubts"] == (
            'glint.estimator is "centroid" here and was "auto" in the sweep'
        )

    def test_the_curve_of_the_tunnels_temperature_is_taken(self, setup_of, tmp_path):
        setup = setup_of('[calibration]\nsweep = "sweep.toml"\n')
        angles = (-3.0, -1.0, 1.0, 3.0)
        fit_sweep_points(
            [
                SweepPoint(f"{t} {a}", a, 1e-4, a + offset, 1e-4, temperature_k=t)
                for t, offset in ((284.0, 0.1), (304.0, 0.3))
                for a in angles
            ]
        ).save(tmp_path / "sweep.toml")
        path = record(tmp_path / "p.h5", 1.0, meta={"tunnel_temperature_K": 289.0})
        result = process_point(path, setup, tmp_path / "out")
        shift = result.record["angle_deg"] - result.record["angle_raw_deg"]
        np.testing.assert_allclose(shift, 0.15, atol=1e-9)
        assert result.record.attrs["tunnel_temperature_K"] == 289.0
        doubt = 0.2 * 0.25 * 0.75 * 0.2  # a fifth, 1 sigma, of the change of 0.2 deg may be bend
        assert (result.record["angle_systematic_std_deg"] > doubt).all()

    def test_another_geometry_is_refused_before_anything_is_measured(
        self, sweep, sweep_files, setup_of, tmp_path
    ):
        sweep.save(tmp_path / "sweep.toml")
        other = setup_of('[calibration]\nsweep = "sweep.toml"\n[glint]\ny = "20 mm"\n')
        message = f"{tmp_path / 'sweep.toml'} was measured with another setup (glint.y is 0.02 m"
        with pytest.raises(CalibrationError, match=f"^{re.escape(message)}"):
            process_point(sweep_files[0], other, tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_points_taken_later_are_held_against_the_sweep(sweep, setup_of, tmp_path):
    setup = setup_of()
    later = [
        record(tmp_path / f"c{number}.h5", angle, row=ROW + 0.5, seed=30 + number, hour=20)
        for number, angle in enumerate((-2.0, 0.0, 2.0))
    ]
    seen = []
    drift = check_sweep(later, sweep, setup, progress=seen.append)
    assert seen == later
    line_mm = 27.5e-6 * 1.4224 / 0.035 * 1e3
    for each in drift.points:
        assert each.intercept_mm == pytest.approx(-0.5 * line_mm, abs=0.02)
        assert each.hours == pytest.approx(12.4, abs=0.1)
    assert drift.verdict == "undecided"
    assert "the model moved up or down" in drift.sentence
