"""Camera calibration: known truth, bad images by name, refusals, the file."""

import dataclasses
import re
import tomllib

import numpy as np
import pytest
import tomli_w
from board_pictures import Lens, chessboard, circles, photograph, pose, views

from calibration.camera.boards import Board, BoardImage, find_boards
from calibration.camera.calibrate import CameraCalibration, Provenance, calibrate_camera
from calibration.photographs import Photograph
from glint_aoa.errors import CalibrationError, OutputError
from glint_aoa.setup import Setup, load_setup

FIELD = Lens()
SQUARE = Lens(0.008, (1e-5, 1e-5), (640, 480), (322.0, 236.0), (-0.2, 0.1, 0.001, -0.0008, 0.0))
BOARD = Board("chessboard", 7, 5, 0.03)
GRID = np.arange(35).reshape(5, 7)


def truth_of(lens):
    return {
        "focal_length_m": lens.focal,
        "pixel_pitch_v_m": lens.pitch[1],
        "principal_point_u": lens.principal[0],
        "principal_point_v": lens.principal[1],
        **dict(zip(["k1", "k2", "p1", "p2", "k3"], lens.distortion, strict=True)),
    }


def images_of(lens, seed=1, n=10, **how):
    return [
        BoardImage(f"board-{k:02d}", f"board-{k:02d}", np.arange(len(uv)), uv)
        for k, (uv, _) in enumerate(
            views(lens, BOARD.places, np.random.default_rng(seed), n, **how)
        )
    ]


def calibrated(images, lens=FIELD, **how):
    options = {
        "sensor": lens.sensor,
        "pixel_pitch": lens.pitch,
        "distortion": 4,
        "board_std": 0.0,
        "draws": 0,
    }
    return calibrate_camera(images, BOARD, **options | how)


def off(fitted, lens):
    """Errors in standard deviations."""
    truth = np.array([truth_of(lens)[name] for name in fitted.parameters])
    return (fitted.values - truth) / fitted.std


def changed(images, k, change):
    images = list(images)
    images[k] = dataclasses.replace(images[k], uv=change(images[k].uv))
    return images


@pytest.fixture(scope="module")
def images():
    return images_of(FIELD)


@pytest.fixture(scope="module")
def fitted(images):
    source = Provenance(files=("a.png",), date="2026-01-12")
    return calibrated(images, draws=100, provenance=source)


class TestTruth:
    @pytest.mark.parametrize("lens", [FIELD, SQUARE], ids=["fields", "square pixels"])
    def test_parameters_are_within_their_uncertainty(self, lens):
        found = calibrated(images_of(lens), lens, board_std=None)
        assert found.parameters == tuple(truth_of(lens))[:8]
        assert np.abs(off(found, lens)).max() < 3.5
        assert found.noise_pixels == pytest.approx((0.05, 0.05), rel=0.12)
        assert found.std[0] / lens.focal < 0.004
        assert not found.left_out

    def test_the_vertical_pitch_given_need_only_be_near(self, images, fitted):
        other = calibrated(images, pixel_pitch=(11.7e-6, 25e-6))
        np.testing.assert_allclose(other.values / fitted.std, fitted.values / fitted.std, atol=5e-3)

    def test_only_the_ratio_to_the_horizontal_pitch_is_seen(self, images, fitted):
        twice = calibrated(images, pixel_pitch=(23.4e-6, 55e-6))
        scale = np.array([2, 2, 1, 1, 1, 1, 1, 1])
        np.testing.assert_allclose(
            twice.values / fitted.std, scale * fitted.values / fitted.std, atol=5e-3
        )

    def test_what_is_held_stays_as_given(self, images):
        found = calibrated(images, hold=["pixel_pitch_v", "principal_point"], distortion=2)
        assert found.pixel_pitch_m == FIELD.pitch
        assert found.principal_point == (375.5, 119.5)
        assert found.parameters == ("focal_length_m", "k1", "k2")
        assert found.hold == ("pixel_pitch_v", "principal_point")

    @pytest.mark.parametrize(("order", "names"), [(0, []), (1, ["k1"]), (5, ["k1", "k2", "p1"])])
    def test_order_of_distortion(self, images, order, names):
        found = calibrated(images, distortion=order)
        assert list(found.parameters[4:])[:3] == names
        assert len(found.parameters) == 4 + order
        assert not any(found.distortion[order:])

    def test_without_a_number_the_lens_models_are_averaged(self, images):
        found = calibrated(images, distortion=None)
        assert np.abs(off(found, FIELD)).max() < 3.5
        assert set(found.criterion) == {4, 5}
        assert min(found.criterion.values()) == 0
        # weights of the two, from the criterion alone
        weights = {order: np.exp(-0.5 * value) for order, value in found.criterion.items()}
        four, five = (calibrated(images, distortion=order) for order in (4, 5))
        share = weights[5] / sum(weights.values())
        k1 = found.parameters.index("k1")
        mean = (1 - share) * four.values[k1] + share * five.values[k1]
        assert found.values[k1] == pytest.approx(mean, abs=0.02 * found.std[k1])
        variance = (1 - share) * (four.std[k1] ** 2 + (four.values[k1] - mean) ** 2) + share * (
            five.std[k1] ** 2 + (five.values[k1] - mean) ** 2
        )
        assert found.std[k1] == pytest.approx(variance**0.5, rel=0.02)
        assert found.std[-1] > share * five.std[-1]

    def test_a_bent_board_is_told_from_the_camera(self):
        bend = 2e-3 * ((BOARD.places[:, 0] - 0.09) / 0.09) ** 2
        real = BOARD.places + np.column_stack([0 * bend, 0 * bend, bend])
        images = images_of(SQUARE, real=real)
        found = calibrated(images, SQUARE, board_std=None)
        assert found.board_std_m == 0.01 * BOARD.spacing
        assert np.abs(off(found, SQUARE)).max() < 3.5
        assert found.board_departure_m > 10 * found.board_departure_std_m
        exact = calibrated(images, SQUARE)
        assert np.abs(off(exact, SQUARE)).max() > 5
        assert exact.board_departure_m == 0

    def test_drawn_chessboards_through_the_whole_chain(self):
        """Interlaced fields, detected and fitted; corners are good to thousandths of a pixel."""
        lens = Lens(0.0175, sensor=(376, 120), principal=(190.3, 58.2))
        rng, board = np.random.default_rng(2), Board("chessboard", 6, 4, 0.03)
        pictures = []
        for k in range(6):
            at = pose(
                25 + 2 * k,
                direction_deg=60 * k + 20,
                turn_deg=90 * k + 6,
                distance=1.5,
                at=0.04 * np.array([np.cos(2 * k), np.sin(2 * k)]),
                middle=(0.075, 0.045),
            )
            drawn = photograph(chessboard(6, 4, 0.03), lens, *at, rng, parity=k % 2)
            pictures.append(Photograph(f"{k}", f"{k}", drawn.astype(np.float32), k % 2))
        images = list(find_boards(pictures, board, aspect=lens.aspect))
        found = calibrate_camera(
            images,
            board,
            sensor=lens.sensor,
            pixel_pitch=lens.pitch,
            distortion=2,
            hold=["principal_point"],
            draws=0,
        )
        assert len(found.left_out) == 0
        assert found.rms_pixels < 0.02

    def test_circles_are_measured_at_their_ellipses_centres(self):
        """Near and large discs; to take them for images of the centres biases the camera."""
        board = Board("circles", 5, 4, 0.04)
        rng, pictures = np.random.default_rng(2), []
        lens = Lens(0.004, (2e-5, 2e-5), (320, 240), (161.0, 118.0), (0.0,) * 5)
        for k in range(5):
            at = pose(
                30,
                direction_deg=72 * k,
                turn_deg=90 * k,
                distance=0.26,
                middle=(0.08, 0.06),
            )
            drawn = photograph(circles(5, 4, 0.04, 0.016), lens, *at, rng, blur=1e-5)
            pictures.append(Photograph(f"{k}", f"{k}", drawn.astype(np.float32)))
        images = list(find_boards(pictures, board))
        assert all(image.found for image in images)
        how = {"sensor": lens.sensor, "pixel_pitch": lens.pitch, "distortion": 1, "draws": 0}
        found = calibrate_camera(images, board, board_std=0.0, **how)
        assert found.rms_pixels < 0.01
        assert found.focal_length_m == pytest.approx(0.004, rel=1e-3)
        centres = [dataclasses.replace(image, radius=0.0) for image in images]
        biased = calibrate_camera(centres, board, board_std=0.0, **how)
        assert abs(biased.focal_length_m / 0.004 - 1) > 4e-3


class TestUncertainty:
    def test_bootstrap_is_seeded_and_like_the_analytic_one(self, images, fitted):
        again = calibrated(images, draws=100)
        np.testing.assert_array_equal(again.bootstrap_covariance, fitted.bootstrap_covariance)
        other = calibrated(images, draws=100, seed=1)
        assert not np.array_equal(other.bootstrap_std, fitted.bootstrap_std)
        ratio = fitted.bootstrap_std / fitted.std
        assert np.all((ratio > 0.4) & (ratio < 2.5))

    def test_pictures_of_one_source_are_resampled_together(self, images):
        pairs = [dataclasses.replace(image, source=f"{k // 2}") for k, image in enumerate(images)]
        assert not np.allclose(
            calibrated(pairs, draws=100).bootstrap_std, calibrated(images, draws=100).bootstrap_std
        )

    def test_without_draws_or_sources_there_is_no_bootstrap(self, images):
        assert calibrated(images).bootstrap_std is None
        two = [dataclasses.replace(image, source=f"{k % 2}") for k, image in enumerate(images)]
        assert calibrated(two, draws=50).bootstrap_covariance is None

    def test_reach_is_the_part_of_the_sensor_that_was_seen(self, images, fitted):
        uv = np.concatenate([image.uv for image in images])
        expected = np.ptp(uv, axis=0) / FIELD.sensor
        assert fitted.reach == pytest.approx(tuple(expected))


class TestBadImages:
    def test_the_end_from_which_a_board_is_listed_does_not_matter(self, images, fitted):
        found = calibrated(changed(images, 3, lambda uv: uv[::-1]))
        plain = calibrated(images)
        np.testing.assert_allclose(found.values / found.std, plain.values / found.std, atol=1e-3)

    def test_exchanged_rows_and_columns_are_repaired_and_said(self, images):
        found = calibrated(changed(images, 3, lambda uv: uv[GRID.T.ravel()]))
        plain = calibrated(images)
        np.testing.assert_allclose(found.values / found.std, plain.values / found.std, atol=1e-3)
        assert found.images[3].used
        assert found.images[3].reason.startswith("corner order repaired: rows and columns")

    def test_a_wrong_order_is_left_out_by_name(self, images):
        swapped = GRID.copy()
        swapped[2, [2, 3]] = swapped[2, [3, 2]]
        found = calibrated(changed(images, 3, lambda uv: uv[swapped.ravel()]))
        (out,) = found.left_out
        assert out.name == "board-03"
        assert out.reason == (
            "its corners are not in the order of a board of 7 x 5; show the whole board from its "
            "front, flat and evenly lit"
        )
        rest = calibrated([image for image in images if image.name != "board-03"])
        np.testing.assert_array_equal(found.values, rest.values)

    def test_a_blurred_image_is_left_out_by_name(self, images):
        rng = np.random.default_rng(3)
        found = calibrated(changed(images, 6, lambda uv: uv + 0.5 * rng.standard_normal(uv.shape)))
        (out,) = found.left_out
        assert out.name == "board-06"
        assert re.fullmatch(
            r"its corners miss the fit by 0\.\d+ pixels, the other images' by 0\.0\d+: the board "
            "moved or bent, the picture is blurred, or another board is seen; photograph it again "
            "at rest",
            out.reason,
        )
        assert np.abs(off(found, FIELD)).max() < 3.5

    def test_an_image_that_fits_but_was_stretched_is_left_out_by_name(self, images):
        """Its board's pose takes the stretch up, and another focal length would."""
        found = calibrated(changed(images, 6, lambda uv: uv * [1.02, 1.0]))
        (out,) = found.left_out
        assert out.name == "board-06"
        assert out.reason == (
            "it asks for another camera than the other images do, although its corners fit: the "
            "board moved while the picture was read out, or it was scaled or refocused; photograph "
            "it again at rest"
        )

    def test_a_corner_that_is_far_off_goes_alone(self, images):
        def pushed(uv):
            moved = uv.copy()
            moved[11] += [3.0, -1.0]
            return moved

        found = calibrated(changed(images, 6, pushed))
        assert not found.left_out
        assert found.images[6].corners == 34
        assert found.images[6].reason == "1 of its corners left out: far off the fit"
        assert np.abs(off(found, FIELD)).max() < 3.5

    def test_images_without_a_board_are_listed_with_their_reason(self, images):
        nothing = BoardImage("dark", "dark", np.empty(0, np.int64), np.empty((0, 2)), note="dark.")
        found = calibrated([*images, nothing])
        assert [(image.name, image.reason) for image in found.left_out] == [("dark", "dark.")]

    def test_when_most_disagree_nobody_is_right(self, images):
        rng, bad = np.random.default_rng(3), list(images[:8])
        for k, noise in enumerate((0.8, 1.5, 3.0, 5.0, 7.0)):
            bad[k] = dataclasses.replace(
                bad[k], uv=bad[k].uv + noise * rng.standard_normal((35, 2)) / [1.0, 2.35]
            )
        message = r"^4 of 7 images disagree with the others; first board-"
        with pytest.raises(CalibrationError, match=message):
            calibrated(bad)


class TestRefusals:
    def refused(self, message, images, **how):
        with pytest.raises(CalibrationError, match=re.escape(message)):
            calibrated(images, **how)

    def test_boards_that_all_face_the_camera(self):
        with pytest.raises(
            CalibrationError,
            match=r"^the images do not determine the focal length: all boards face the camera "
            r"nearly squarely \(tilted by \d\.\d to \d\.\d deg\), which does not tell focal length "
            "from distance; tilt the board by 20 to 40 deg, to another side in each image$",
        ):
            calibrated(images_of(FIELD, tilt_deg=(0.0, 0.01)))

    def test_boards_that_are_all_tilted_alike(self):
        rng, images = np.random.default_rng(4), []
        for k in range(8):
            at = pose(
                25,
                direction_deg=40,
                distance=1.5,
                at=rng.uniform(-0.05, 0.05, 2),
                middle=(0.09, 0.06),
            )
            uv = FIELD.project(BOARD.places, *at) + 0.05 * rng.standard_normal((35, 2))
            images.append(BoardImage(f"{k}", f"{k}", np.arange(35), uv))
        with pytest.raises(
            CalibrationError,
            match=r"^the images do not determine the focal length: all boards are tilted alike "
            r"\(within \d\.\d deg\); tilt the board to another side in each image$",
        ):
            calibrated(images)

    def test_one_image(self, images):
        nothing = BoardImage("dark", "dark", np.empty(0, np.int64), np.empty((0, 2)), note="dark.")
        self.refused(
            "a camera is calibrated from 3 images of the board or more, better 12, and 1 is "
            "usable; dark: dark.",
            [images[0], nothing],
        )

    def test_no_image(self):
        self.refused(
            "a camera is calibrated from 3 images of the board or more, better 12, and none is "
            "usable; photograph the board at other places and tilts",
            [],
        )

    def test_a_point_that_is_not_on_the_sensor(self, images):
        self.refused(
            "beyond a sensor of 450 x 240; correct camera.sensor", images, sensor=(450, 240)
        )

    @pytest.mark.parametrize(
        ("spacing", "message"),
        [
            (30e-6, "squares of 0.03 mm put the board 0.00"),
            (30.0, "squares of 3e+04 mm put the board 1"),
        ],
    )
    def test_squares_in_another_unit(self, images, spacing, message):
        board = dataclasses.replace(BOARD, spacing=spacing)
        with pytest.raises(
            CalibrationError,
            match=f"^{re.escape(message)}.*; check the unit of the board's spacing$",
        ):
            calibrate_camera(
                images, board, sensor=FIELD.sensor, pixel_pitch=FIELD.pitch, distortion=2, draws=0
            )

    @pytest.mark.parametrize(
        ("pitch", "message"),
        [
            (
                (11.7e-3, 27.5e-3),
                "a pixel pitch of 1.17e+04 um x 2.75e+04 um cannot be; give the sensor's, such as "
                "11.7 um x 27.5 um",
            ),
            ((11.7e-9, 27.5e-9), "mm for a horizontal pixel pitch of 0.0117 um; check the unit"),
            (
                (11.7e-6, 55e-6),
                "um where 55 um was given; the pictures are frames where the pitch is that of "
                "fields: give --scan interlaced",
            ),
            (
                (11.7e-6, 13.75e-6),
                "um where 13.75 um was given; the pictures are fields where the pitch is that of "
                "frames: give that of field lines",
            ),
            (
                (11.7e-6, 20e-6),
                "um where 20 um was given; check both pixel pitches, and that the pictures were "
                "not scaled",
            ),
        ],
    )
    def test_pixel_pitch_in_another_unit_or_of_another_scan(self, images, pitch, message):
        self.refused(message, images, pixel_pitch=pitch)

    def test_a_lens_model_that_folds_over_on_the_sensor(self):
        """Corners in the middle third say nothing of the edges."""
        lens = dataclasses.replace(SQUARE, distortion=(-2.0, 0.0, 0.0, 0.0, 0.0))
        middle = dataclasses.replace(lens, sensor=(200, 150), principal=(102.0, 76.0))
        shifted = [
            dataclasses.replace(image, uv=image.uv + np.array([220.0, 160.0]))
            for image in images_of(middle, noise=0.01)
        ]
        with pytest.raises(
            CalibrationError,
            match=re.escape(
                "the lens model folds over inside the sensor with 1 distortion coefficients: no "
                "corners near the edges hold it; photograph the board in the corners of the "
                "picture, or choose fewer coefficients"
            ),
        ):
            calibrated(shifted, lens, distortion=1)

    @pytest.mark.parametrize(
        ("how", "message"),
        [
            (
                {"distortion": 3},
                "distortion is 3; give the number of coefficients: 0, 1 (k1), 2 (k2), 4 (p1 and "
                "p2) or 5 (k3)",
            ),
            ({"hold": ["k1"]}, 'hold is "k1"; give one of pixel_pitch_v, principal_point'),
            ({"sensor": (0, 5)}, "a sensor of 0 x 5 pixels cannot be"),
            (
                {"board_std": -1.0},
                "the board's std is -1 m; give zero for an exact board, or more",
            ),
            ({"draws": 1}, "draws is 1; give 0 for no bootstrap, or some hundred"),
        ],
    )
    def test_options_that_cannot_be(self, images, how, message):
        self.refused(message, images, **how)


class TestFile:
    @pytest.fixture
    def path(self, fitted, tmp_path):
        fitted.save(tmp_path / "camera.toml")
        return tmp_path / "camera.toml"

    def test_it_comes_back(self, fitted, path):
        again = CameraCalibration.load(path)
        np.testing.assert_allclose(again.values, fitted.values, rtol=1e-14)
        np.testing.assert_array_equal(again.covariance, fitted.covariance)
        np.testing.assert_array_equal(again.bootstrap_covariance, fitted.bootstrap_covariance)
        for name in (
            "sensor",
            "parameters",
            "rms_pixels",
            "noise_pixels",
            "degrees_of_freedom",
            "board",
            "board_std_m",
            "board_departure_m",
            "hold",
            "criterion",
            "draws",
            "seed",
            "provenance",
        ):
            assert getattr(again, name) == getattr(fitted, name), name
        assert [image.name for image in again.images] == [image.name for image in fitted.images]
        assert again.images[2].rms == fitted.images[2].rms
        assert np.isnan(again.reach).all()

    def test_pictures_left_out_keep_their_reason(self, images, tmp_path):
        nothing = BoardImage("dark", "dark", np.empty(0, np.int64), np.empty((0, 2)), note="dark.")
        calibrated([*images, nothing]).save(tmp_path / "camera.toml")
        (out,) = CameraCalibration.load(tmp_path / "camera.toml").left_out
        assert (out.name, out.reason) == ("dark", "dark.")
        assert np.isnan(out.rms)

    def test_its_camera_is_a_setups(self, fitted, path):
        section = tomllib.loads(path.read_text())["camera"]
        assert section == fitted.camera_section()
        position = {"position": ["0 m", "-56 in", "60 mm"]}
        camera = Setup.model_validate({"camera": section | position}).camera
        assert camera.focal_length == pytest.approx(fitted.focal_length_m, rel=1e-14)
        assert camera.pixel_pitch == pytest.approx(fitted.pixel_pitch_m, rel=1e-14)
        assert camera.principal_point == fitted.principal_point
        assert camera.distortion == fitted.distortion

    def test_a_setup_can_name_it(self, fitted, path):
        setup = path.with_name("glint-aoa.toml")
        setup.write_text(
            '[camera]\nposition = ["0 m", "-56 in", "60 mm"]\n'
            '[calibration]\ncamera = "camera.toml"\n'
        )
        camera = load_setup(setup).camera
        assert camera.focal_length == pytest.approx(fitted.focal_length_m, rel=1e-14)

    def test_nothing_is_replaced_unasked(self, fitted, path):
        message = f"{path}: exists already; choose another name or allow overwriting"
        with pytest.raises(OutputError, match=re.escape(message)):
            fitted.save(path)
        fitted.save(path, overwrite=True)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            (lambda c: c.update(kind="pitch sweep"), "kind: Input should be 'camera calibration'"),
            (lambda c: c["camera"].pop("sensor"), "camera.sensor: missing"),
            (
                lambda c: c["camera"].update(colour="red"),
                "unknown key camera.colour; known keys here: focal_length, pixel_pitch, sensor, "
                "principal_point, distortion",
            ),
            (
                lambda c: c["covariance"]["matrix"].pop(),
                "covariance.matrix must be 8 x 8, as the parameters are",
            ),
            (
                lambda c: c["covariance"]["matrix"][0].__setitem__(1, 1.0),
                "covariance.matrix is not symmetric",
            ),
            (
                lambda c: c["covariance"]["matrix"][0].__setitem__(0, -1.0),
                "covariance.matrix has a variance that is not greater than zero",
            ),
            (
                lambda c: c["covariance"]["parameters"].__setitem__(1, "focal_length_m"),
                "covariance.parameters names one twice",
            ),
            (
                lambda c: c["bootstrap"]["matrix"][3].pop(),
                "bootstrap.matrix must be 8 x 8, as the parameters are",
            ),
        ],
    )
    def test_what_is_no_calibration_is_refused(self, path, change, said):
        content = tomllib.loads(path.read_text())
        change(content)
        path.write_text(tomli_w.dumps(content))
        message = (
            f"{path}: not a camera calibration that can be used ({said}); repeat glint-aoa "
            "calibrate camera"
        )
        with pytest.raises(CalibrationError, match=re.escape(message)):
            CameraCalibration.load(path)

    def test_a_matrix_that_is_no_covariance(self, path):
        content = tomllib.loads(path.read_text())
        matrix = content["covariance"]["matrix"]
        matrix[0][1] = matrix[1][0] = 2 * (matrix[0][0] * matrix[1][1]) ** 0.5
        path.write_text(tomli_w.dumps(content))
        with pytest.raises(CalibrationError, match=r"covariance\.matrix has a negative variance"):
            CameraCalibration.load(path)

    def test_a_file_that_is_not_there(self, tmp_path):
        message = "no such camera calibration; make one with glint-aoa calibrate camera"
        with pytest.raises(CalibrationError, match=re.escape(message)):
            CameraCalibration.load(tmp_path / "none.toml")
