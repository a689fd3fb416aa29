"""The adjustment of camera, poses and board: OpenCV's calibration, closed forms, finite steps."""

import dataclasses

import cv2
import numpy as np
import pytest
from board_pictures import Lens, pose
from board_pictures import views as board_views
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate
from threadpoolctl import threadpool_limits

from calibration.camera._bundle import (
    Interior,
    Observation,
    Problem,
    State,
    adjust,
    inverted,
    project_board,
    resampled,
)
from glint_aoa.geometry import PixelToPlane

SQUARE = Lens(0.008, (1e-5, 1e-5), (640, 480), (322.0, 236.0), (-0.2, 0.1, 0.001, -0.0008, 0.02))
FIELD = Lens()
PLACES = np.array([[0.03 * i, 0.03 * j, 0.0] for j in range(5) for i in range(7)])
NOISE = 0.05


def values_of(lens):
    return np.array([lens.focal / lens.pitch[0], lens.aspect, *lens.principal, *lens.distortion])


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    with threadpool_limits(limits=1, user_api="blas"):
        yield


def views(lens, rng, n=8, *, noise=NOISE, places=PLACES):
    """Observations of boards, and their poses."""
    seen = board_views(lens, PLACES, rng, n, noise=noise, real=places)
    observations = tuple(Observation(np.arange(len(uv)), uv) for uv, _ in seen)
    return observations, np.array([np.concatenate(at) for _, at in seen])


def free(*, aspect=True, principal=True, order=5):
    return np.array([True, aspect, principal, principal, *(k < order for k in range(5))])


def problem_of(observations, which, *, place_std=0.0, noise=NOISE, places=PLACES):
    return Problem(observations, places, place_std, 0.0, which, np.full(2, noise))


def start(lens, poses, *, order=5):
    values = values_of(lens)
    values[4 + order :] = 0.0
    return State(Interior(values), poses, PLACES)


def opencv(observations, lens, flags):
    board = PLACES.astype(np.float32)
    matrix = Interior(values_of(lens)).matrix
    return cv2.calibrateCameraExtended(
        [board] * len(observations),
        [one.uv.astype(np.float32) for one in observations],
        lens.sensor,
        matrix.copy(),
        np.zeros(5),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-16),
    )


class TestOpenCV:
    @pytest.mark.parametrize(
        ("lens", "order", "aspect", "flags"),
        [
            pytest.param(SQUARE, 5, True, 0, id="square pixels"),
            pytest.param(
                SQUARE, 2, True, cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3, id="k1 and k2"
            ),
            pytest.param(
                SQUARE,
                4,
                False,
                cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K3,
                id="square, fixed aspect",
            ),
            pytest.param(FIELD, 4, True, cv2.CALIB_FIX_K3, id="fields"),
            pytest.param(
                FIELD,
                4,
                False,
                cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K3,
                id="fields, fixed aspect",
            ),
        ],
    )
    def test_camera_uncertainty_and_rms_are_opencvs(self, lens, order, aspect, flags):
        observations, poses = views(lens, np.random.default_rng(3))
        observations = tuple(
            one._replace(uv=one.uv.astype(np.float32).astype(float)) for one in observations
        )
        float32 = PLACES.astype(np.float32).astype(float)
        problem = problem_of(observations, free(aspect=aspect, order=order), places=float32)
        result = adjust(problem, start(lens, poses, order=order)._replace(places=float32))
        rms, matrix, distortion, *_, std, _, _ = opencv(observations, lens, flags)
        assert result.converged
        ours, theirs = result.state.interior, std.ravel()
        scatter = np.sqrt(np.sum([np.sum(each**2) for each in result.residuals]) / 280)
        assert scatter == pytest.approx(rms, rel=1e-7)
        picked = [0 if aspect else 1, 2, 3, *range(4, 4 + order)]  # fy where the ratio is fixed
        found, expected = (
            np.array([*np.diag(m)[:2], *m[:2, 2], *d.ravel()])[picked]
            for m, d in ((ours.matrix, ours.distortion), (matrix, distortion))
        )
        np.testing.assert_allclose(
            found / theirs[picked], expected / theirs[picked], atol=3e-3, rtol=0
        )
        assert ours.matrix[0, 0] == pytest.approx(matrix[0, 0], rel=1e-6)
        # OpenCV takes the noise from the residuals, ours was stated
        freedom = sum(each.sum() for each in result.freedom)
        own = np.sqrt(np.diag(result.covariance) * result.cost / freedom)
        own[1] = own[0] / lens.aspect
        np.testing.assert_allclose(own[picked], theirs[picked], rtol=3e-3)

    def test_degrees_of_freedom_are_observations_less_unknowns(self):
        observations, poses = views(SQUARE, np.random.default_rng(3))
        result = adjust(problem_of(observations, free()), start(SQUARE, poses))
        assert sum(each.sum() for each in result.freedom) == pytest.approx(8 * 70 - 9 - 6 * 8)


class TestModel:
    def test_projection_is_that_of_the_setup(self):
        """OpenCV's camera looks along its z; ours along y with z up."""
        turn, shift = pose(25, direction_deg=40, turn_deg=10, distance=1.5)
        uv, _ = project_board(PLACES, Interior(values_of(FIELD)), np.concatenate([turn, shift]))
        right, down, ahead = (PLACES @ cv2.Rodrigues(turn)[0].T + shift).T
        mapping = PixelToPlane(
            principal_point=FIELD.principal,
            pixel_pitch=FIELD.pitch,
            focal_length=FIELD.focal,
            distortion=FIELD.distortion,
            position=(0.0, 0.0, 0.0),
        )
        expected = mapping.project(np.stack([right, ahead, -down], axis=-1))
        np.testing.assert_allclose(uv, np.stack(expected, axis=-1), atol=1e-9)

    @settings(max_examples=15)
    @given(st.floats(5, 50), st.floats(0, 360), st.floats(-180, 180))
    def test_circles_are_seen_at_their_ellipses_centre(self, tilt, direction, turn_deg):
        """The centre of area of the image of a disc, by integration along its edge."""
        lens = Lens(distortion=(0.0,) * 5)
        radius, centre = 0.012, np.array([[0.03, 0.02, 0.0]])
        turn, shift = pose(tilt, direction_deg=direction, turn_deg=turn_deg, distance=0.4)
        at = np.concatenate([turn, shift])
        uv, _ = project_board(centre, Interior(values_of(lens)), at, radius=radius)
        angle = np.linspace(0, 2 * np.pi, 2001)
        edge = centre + radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        x, y = lens.project(edge, turn, shift).T
        area = integrate.simpson(x * np.gradient(y, angle), x=angle)
        moments = [
            integrate.simpson(x * x / 2 * np.gradient(y, angle), x=angle),
            -integrate.simpson(y * y / 2 * np.gradient(x, angle), x=angle),
        ]
        np.testing.assert_allclose(uv[0], np.array(moments) / area, atol=1e-4)
        assert not np.allclose(uv, lens.project(centre, turn, shift), atol=1e-3)

    @pytest.mark.parametrize("radius", [0.0, 0.01])
    def test_without_noise_the_truth_comes_back(self, radius):
        observations, poses = views(SQUARE, np.random.default_rng(5), noise=0.0)
        truth = Interior(values_of(SQUARE))
        observations = tuple(
            one._replace(uv=project_board(PLACES, truth, at, radius=radius)[0])
            for one, at in zip(observations, poses, strict=True)
        )
        beside = Interior(values_of(SQUARE) * 1.001)
        problem = dataclasses.replace(
            problem_of(observations, free(), place_std=1e-4), radius=radius
        )
        result = adjust(problem, State(beside, poses, PLACES))
        assert result.converged
        off = (result.state.interior.values - truth.values) / np.sqrt(np.diag(result.covariance))
        assert np.abs(off).max() < 1e-3


class TestBoard:
    BENT = PLACES + np.column_stack([0 * PLACES[:, :2], 0.4 * (PLACES[:, 0] - 0.09) ** 2])

    def test_a_bent_board_is_found_and_does_not_bias_the_camera(self):
        """The bend is 3.2 mm on 180 mm; what of it is tilt or place of the board is taken out."""
        observations, poses = views(SQUARE, np.random.default_rng(7), 12, places=self.BENT)
        problem = problem_of(observations, free(), place_std=1e-3)
        result = adjust(problem, start(SQUARE, poses))
        error = result.state.interior.values - values_of(SQUARE)
        assert np.all(np.abs(error) < 3.5 * np.sqrt(np.diag(result.covariance)))
        bend = result.state.places[:, 2].reshape(5, 7)
        found = bend[:, 0] - 2 * bend[:, 3] + bend[:, 6]
        assert found == pytest.approx(2 * 0.4 * 0.09**2, rel=0.03)  # its size is not told
        assert 0 < result.shape_std < 1e-4

    def test_an_exact_board_would_have_biased_it(self):
        observations, poses = views(SQUARE, np.random.default_rng(7), 12, places=self.BENT)
        result = adjust(problem_of(observations, free()), start(SQUARE, poses))
        error = result.state.interior.values - values_of(SQUARE)
        assert np.abs(error[0]) > 5 * np.sqrt(result.cost / 800 * result.covariance[0, 0])

    def test_a_board_that_is_held_is_told_no_shape(self):
        observations, poses = views(SQUARE, np.random.default_rng(7))
        result = adjust(problem_of(observations, free()), start(SQUARE, poses))
        assert result.shape_std == 0
        np.testing.assert_array_equal(result.state.places, PLACES)


class TestResampling:
    @pytest.mark.parametrize("place_std", [0.0, 3e-4])
    def test_it_is_the_fit_to_the_resampled_images(self, place_std):
        """To first order: the step is a tenth of what the full fit differs by."""
        observations, poses = views(SQUARE, np.random.default_rng(11), 10)
        which = free(order=2)
        problem = problem_of(observations, which, place_std=place_std)
        result = adjust(problem, start(SQUARE, poses, order=2))
        counts = np.array([[2.0, 0, 1, 1, 0, 2, 1, 1, 1, 1]])
        drawn = resampled(problem, result.state, counts)[0]
        repeated = [k for k in range(10) for _ in range(int(counts[0, k]))]
        again = adjust(
            problem_of(tuple(observations[k] for k in repeated), which, place_std=place_std),
            result.state._replace(poses=result.state.poses[repeated]),
        )
        moved = (again.state.interior.values - result.state.interior.values)[which]
        std = np.sqrt(np.diag(result.covariance))[which]
        np.testing.assert_allclose(drawn / std, moved / std, atol=0.1 * np.abs(moved / std).max())

    def test_each_image_once_changes_nothing(self):
        observations, poses = views(SQUARE, np.random.default_rng(11))
        problem = problem_of(observations, free(), place_std=3e-4)
        result = adjust(problem, start(SQUARE, poses))
        drawn = resampled(problem, result.state, np.ones((1, 8)))[0]
        assert np.all(np.abs(drawn) < 2e-3 * np.sqrt(np.diag(result.covariance)))

    def test_a_draw_that_determines_nothing_is_nan(self):
        observations, poses = views(SQUARE, np.random.default_rng(11))
        problem = problem_of(observations, free())
        result = adjust(problem, start(SQUARE, poses))
        assert np.isnan(resampled(problem, result.state, np.zeros((1, 8)))).all()


class TestInverse:
    def test_scales_of_many_powers_of_ten_do_no_harm(self):
        rng = np.random.default_rng(2)
        plain = rng.standard_normal((9, 6))
        scale = 10.0 ** np.array([-6, -3, 0, 3, 6, 9])
        normal = (plain * scale).T @ (plain * scale)
        expected = np.linalg.inv(plain.T @ plain) / np.outer(scale, scale)
        np.testing.assert_allclose(inverted(normal), expected, rtol=1e-12)

    @pytest.mark.parametrize("normal", [np.zeros((2, 2)), -np.eye(2), np.full((2, 2), np.nan)])
    def test_what_determines_nothing_is_refused(self, normal):
        with pytest.raises(np.linalg.LinAlgError):
            inverted(normal)
