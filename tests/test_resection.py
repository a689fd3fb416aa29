import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent_camera import TO_OPENCV, turned
from known_targets import (
    ALIGNED,
    ANGLES,
    APPROXIMATE,
    STD,
    TRUE,
    board,
    field,
    in_setup,
    in_space,
    seen,
    true_pose,
)

from benchmarks.resection_coverage import coverage
from calibration.resection._attitude import textbook_angles, tunnel_angles
from calibration.resection.resect import ResectionProvenance, SpaceResection, resect
from calibration.resection.target_field import ImageTargets
from glint_aoa.errors import CalibrationError, OutputError
from glint_aoa.geometry import rotation_matrix

# What is exact


@pytest.mark.parametrize("points", [board(), in_space()], ids=["in a plane", "in space"])
@pytest.mark.parametrize("stated", [True, False])
def test_a_pose_without_noise_is_found_to_rounding(points, stated):
    found = resect(field(points), seen(points, stated=stated), in_setup(APPROXIMATE))
    np.testing.assert_allclose(found.pose, true_pose(), atol=1e-10)
    assert found.coplanar == np.allclose(points, board())


@settings(max_examples=25)
@given(
    place=st.tuples(st.floats(-0.3, 0.3), st.floats(-2.5, -1.2), st.floats(-0.2, 0.3)),
    rotation=st.tuples(st.floats(-30, 30), st.floats(-60, 60), st.floats(-30, 30)),
)
def test_a_camera_anywhere_is_found(place, rotation):
    camera = replace(TRUE, position=place, rotation=rotation, distortion=(0.0,) * 5)
    aim = turned("z", rotation[2]) @ turned("y", rotation[1]) @ turned("x", rotation[0])
    # in view, wherever the camera looks
    points = np.array(place) + (in_space() + np.array([0, 1.5, -0.05])) @ aim.T
    measured = seen(points, camera=camera)
    setup = in_setup(replace(camera, position=tuple(np.add(place, 0.1))))
    found = resect(field(points), measured, setup)
    np.testing.assert_allclose(found.pose, true_pose(camera), atol=1e-8)


def test_an_aligned_camera_in_closed_form():
    """Two targets side by side: their distance in the image gives the distance of the camera."""
    points = np.array([[-0.1, 0.0, 0.05], [0.1, 0.0, 0.05]])
    u, v = np.array([100.0, 600.0]), 130.0
    measured = ImageTargets(("A", "B"), np.stack([u, [v, v]], axis=-1))
    found = resect(field(points, ("A", "B")), measured, in_setup(ALIGNED), hold=ANGLES)
    distance = 0.2 / (500 * 11.7e-6) * 0.035
    expected = (
        -0.1 - (100 - 375.5) * 11.7e-6 / 0.035 * distance,
        -distance,
        0.05 + (130 - 119.5) * 27.5e-6 / 0.035 * distance,
    )
    np.testing.assert_allclose(found.position_m, expected, atol=1e-12)
    assert found.rotation_rad.tolist() == [0.0, 0.0, 0.0]


# Agreement with OpenCV


def solve_pnp(points, uv, camera):
    """OpenCV's pose, as X, Y, Z, omega, phi, kappa."""
    matrix = np.diag([camera.focal / camera.pitch[0], camera.focal / camera.pitch[1], 1.0])
    matrix[:2, 2] = camera.principal
    lens = np.array(camera.distortion)
    _, turn, shift = cv2.solvePnP(points, uv, matrix, lens, flags=cv2.SOLVEPNP_ITERATIVE)
    turn, shift = cv2.solvePnPRefineLM(
        points,
        uv,
        matrix,
        lens,
        turn,
        shift,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15),
    )
    rotation = cv2.Rodrigues(turn)[0]
    place = -rotation.T @ shift.ravel()
    return np.concatenate([place, tunnel_angles(rotation.T @ TO_OPENCV)])


def errors(points, camera, std, n, *, stated=True):
    """Errors of ours and of OpenCV's poses [draw, 6], and the differences in our 1 sigma."""
    ours, theirs, differences = [], [], []
    setup = in_setup(camera)
    for seed in range(n):
        rng = np.random.default_rng([7, seed])
        measured = seen(points, camera=camera, rng=rng, std=std, stated=stated)
        found = resect(field(points), measured, setup)
        if all(each.used for each in found.targets):
            other = solve_pnp(points, measured.uv, camera)
            ours.append(found.pose - true_pose(camera))
            theirs.append(other - true_pose(camera))
            differences.append((found.pose - other) / found.std)
    assert len(ours) >= 0.95 * n
    return np.array(ours), np.array(theirs), np.array(differences)


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


SQUARE = replace(TRUE, pitch=(11.7e-6, 11.7e-6), sensor=(752, 576), principal=(375.5, 287.5))


@pytest.mark.parametrize("points", [board(), in_space()], ids=["in a plane", "in space"])
@pytest.mark.parametrize("stated", [True, False], ids=["stated", "estimated"])
def test_with_square_pixels_and_equal_weights_the_pose_is_opencvs(points, stated):
    _, _, difference = errors(points, SQUARE, np.array([0.05, 0.05]), 4, stated=stated)
    assert np.abs(difference).max() < 1e-3  # as far as OpenCV iterates


def test_with_noise_equal_in_metres_the_pose_is_better_than_opencvs():
    """On pixels of 11.7 x 27.5 um a spot's centre is known better in lines than in columns."""
    std = 1e-6 / np.array(TRUE.pitch)
    ours, theirs, _ = errors(board(), TRUE, std, 50, stated=False)
    ratio = rms(ours) / rms(theirs)
    assert ratio[[0, 1, 5]].max() < 0.85  # X, Y, kappa
    assert ratio.max() < 1.02


def test_with_noise_equal_in_pixels_and_stated_the_pose_is_as_good_as_opencvs():
    _, _, difference = errors(in_space(), TRUE, np.array([0.05, 0.05]), 4)
    assert np.abs(difference).max() < 1e-3


# The covariance


def test_intervals_hold_the_truth():
    """A short draw of the benchmark; `make coverage` has 2,000 of each."""
    rows = coverage(30, 5, ["coplanar", "in space"])
    inside = np.array([row.inside for row in rows])
    assert len(rows) == 12
    assert inside.min() >= 0.83  # three standard deviations of 30 draws below 95 %
    for row in rows:  # likewise of the rms of 30 draws
        assert row.rms_error == pytest.approx(row.median_std, rel=0.39)


def test_noise_beyond_the_stated_widens_the_covariance_and_less_does_not_shrink_it():
    points, rng = in_space(), np.random.default_rng(4)
    large, small = (
        resect(
            field(points),
            replace_covariance(seen(points, rng=rng, std=factor * STD), STD),
            in_setup(APPROXIMATE),
        )
        for factor in (4.0, 0.2)
    )
    assert large.excess == pytest.approx(large.chi_square / large.degrees_of_freedom)
    assert 2.5 < np.sqrt(large.excess) < 5.5
    assert small.excess == 1.0
    assert all(each.used for each in large.targets)
    np.testing.assert_allclose(large.std / small.std, np.sqrt(large.excess), rtol=0.02)


def replace_covariance(measured, std):
    covariance = np.broadcast_to(np.diag(np.square(std)), (len(measured), 2, 2))
    return ImageTargets(measured.ids, measured.uv, covariance)


def test_uncertain_targets_make_an_uncertain_pose():
    points = in_space()
    measured, camera = seen(points), in_setup(APPROXIMATE)
    sure, unsure = (resect(field(points, std=std), measured, camera) for std in (0.0, 1e-4))
    assert (unsure.std > 3 * sure.std).all()
    # 0.1 mm is 0.21 pixels in u at 1.4 m
    assert unsure.targets[5].std_u == pytest.approx(0.21, rel=0.1)


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("focal_length_m", 1e-6),
        ("pixel_pitch_h_m", 1e-10),
        ("pixel_pitch_v_m", 1e-10),
        ("principal_point_u", 0.01),
        ("principal_point_v", 0.01),
        ("k1", 1e-4),
        ("k2", 1e-3),
        ("p1", 1e-5),
        ("p2", 1e-5),
        ("k3", 1e-2),
    ],
)
def test_sensitivity_is_what_another_interior_does_to_the_pose(name, step):
    points = in_space()
    measured = seen(points)
    poses = [
        resect(field(points), measured, in_setup(interior(name, sign * step))).pose
        for sign in (1, -1)
    ]
    found = resect(field(points), measured, in_setup(APPROXIMATE))
    column = found.sensitivity[:, found.interior_parameters.index(name)]
    numeric = (poses[0] - poses[1]) / (2 * step)
    np.testing.assert_allclose(column, numeric, rtol=1e-3, atol=1e-4 * np.abs(numeric).max())


def interior(name, change):
    """The approximate camera with one parameter changed."""
    if name == "focal_length_m":
        return replace(APPROXIMATE, focal=APPROXIMATE.focal + change)
    if name.startswith(("pixel_pitch", "principal_point")):
        attribute, axis = ("pitch", "hv") if name.startswith("pixel") else ("principal", "uv")
        values = list(getattr(APPROXIMATE, attribute))
        values[axis.index(name.removesuffix("_m")[-1])] += change
        return replace(APPROXIMATE, **{attribute: tuple(values)})
    lens = list(APPROXIMATE.distortion)
    lens[("k1", "k2", "p1", "p2", "k3").index(name)] += change
    return replace(APPROXIMATE, distortion=tuple(lens))


# Wrong targets


def test_wrong_targets_are_left_out_by_name_with_the_reason():
    points = in_space()
    measured = seen(points, rng=np.random.default_rng(1))
    uv = measured.uv.copy()
    uv[2, 0] += 1.5
    uv[7, 1] -= 30.0
    found = resect(
        field(points), ImageTargets(measured.ids, uv, measured.covariance), in_setup(APPROXIMATE)
    )
    assert {each.id for each in found.targets if not each.used} == {"T3", "T8"}
    by_name = {each.id: each for each in found.targets}
    assert re.fullmatch(r"1\.\d+ pixels off, \d\d standard deviations", by_name["T3"].reason)
    assert by_name["T8"].residual_v == pytest.approx(-30, abs=0.1)
    rest = [i for i in range(12) if i not in {2, 7}]
    clean = resect(
        field(points),
        ImageTargets(tuple(measured.ids[i] for i in rest), uv[rest], measured.covariance[rest]),
        in_setup(APPROXIMATE),
    )
    np.testing.assert_allclose(found.pose, clean.pose, atol=1e-9)
    np.testing.assert_allclose(found.covariance, clean.covariance, rtol=1e-5)


@pytest.mark.parametrize("stated", [True, False])
def test_four_of_twelve_names_mixed_up_do_not_disturb_the_pose(stated):
    points = board()
    measured = seen(points, rng=np.random.default_rng(2), stated=stated)
    order = [4, 1, 2, 7, 0, 5, 6, 3, 8, 9, 10, 11]
    found = resect(
        field(points),
        ImageTargets(measured.ids, measured.uv[order], measured.covariance),
        in_setup(APPROXIMATE),
    )
    assert [each.id for each in found.targets if not each.used] == ["T1", "T4", "T5", "T8"]
    assert (np.abs(found.pose - true_pose()) < 4 * found.std).all()


# A plane that is seen squarely from far away


def test_of_two_poses_that_a_plane_allows_the_nearer_to_the_setup_is_taken():
    points = 0.2 * board(tilt=0.0)
    found = []
    for tilt in (-5.0, 5.0):
        camera = replace(APPROXIMATE, rotation=(tilt, 0.0, 0.0))
        measured = seen(points, rng=np.random.default_rng(2))
        found.append(resect(field(points), measured, in_setup(camera)))
    below, above = found
    assert below.mirror.ambiguous
    assert above.mirror.ambiguous
    assert below.rotation_rad[0] < above.rotation_rad[0]
    np.testing.assert_allclose(below.mirror.rotation_deg, np.degrees(above.rotation_rad), atol=1e-3)
    np.testing.assert_allclose(
        above.mirror.chi_square_above, -below.mirror.chi_square_above, atol=1e-3
    )


def test_a_plane_that_is_tilted_allows_one_pose():
    points = board(tilt=30.0)
    measured = seen(points, rng=np.random.default_rng(4))
    mirror = resect(field(points), measured, in_setup(APPROXIMATE)).mirror
    assert mirror is None


@pytest.mark.parametrize("seed", [1, 6, 8])
def test_a_small_tilt_that_a_plane_hardly_shows_widens_the_covariance(seed):
    """At 2 standard deviations chi-square is to have grown by 4, on the slower side just so."""
    points, std = 0.5 * board(tilt=0.0), np.array([0.15, 0.08])
    measured = seen(points, rng=np.random.default_rng([13, seed]), std=std)
    found = resect(field(points), measured, in_setup(APPROXIMATE))
    growth = []
    for i in (3, 5):  # omega and kappa
        for side in (-2, 2):
            angles = np.degrees(found.rotation_rad)
            angles[i - 3] = np.degrees(found.pose[i] + side * found.std[i])
            setup = in_setup(replace(APPROXIMATE, rotation=tuple(angles)))
            held = resect(field(points), measured, setup, hold=[ANGLES[i - 3]])
            growth.append(held.chi_square - found.chi_square)
    assert found.widening > 1.3
    assert min(growth) == pytest.approx(4, rel=0.1)


# What is held, and the tape


def test_the_papers_form_aligned_camera_and_taped_distance():
    points, rng = board(tilt=0.0), np.random.default_rng(5)
    found = resect(
        field(points),
        seen(points, camera=ALIGNED, rng=rng),
        in_setup(ALIGNED),
        hold=ANGLES,
        distance_m=1.425,
        distance_std_m=0.005,
    )
    assert found.held == ANGLES
    assert found.rotation_rad.tolist() == [0.0, 0.0, 0.0]
    assert found.std[3:].tolist() == [0.0, 0.0, 0.0]
    assert (np.abs(found.position_m - ALIGNED.position) < 4 * found.std[:3]).all()
    assert found.degrees_of_freedom == 2 * 12 + 1 - 3


def test_a_taped_distance_counts_by_its_uncertainty():
    """With targets that say Y = -1.4224 m to s_t, the mean is weighted by 1 / s^2."""
    points = board(tilt=0.0)
    measured, camera = seen(points, camera=ALIGNED), in_setup(ALIGNED)
    alone = resect(field(points), measured, camera, hold=ANGLES)
    tape_std = float(alone.std[1])
    taped = resect(
        field(points),
        measured,
        camera,
        hold=ANGLES,
        distance_m=1.4224 + tape_std,
        distance_std_m=tape_std,
    )
    assert taped.position_m[1] == pytest.approx(-1.4224 - tape_std / 2, abs=1e-3 * tape_std)
    assert taped.std[1] == pytest.approx(tape_std / np.sqrt(2), rel=1e-3)


def test_what_is_held_is_carried_to_the_position():
    """A camera that is turned towards -X sees the same targets alike from further to +X."""
    points = board(tilt=0.0)
    std = np.radians(0.2)
    found = resect(
        field(points),
        seen(points, camera=ALIGNED),
        in_setup(ALIGNED),
        hold=ANGLES,
        hold_std={"kappa": std},
    )
    assert found.std[5] == pytest.approx(std)
    assert found.std[0] == pytest.approx(1.4224 * std, rel=0.02)
    correlation = found.covariance[0, 5] / (found.std[0] * found.std[5])
    assert correlation == pytest.approx(1, abs=0.001)


def test_what_is_held_wrong_by_its_uncertainty_is_no_excess():
    camera = replace(ALIGNED, rotation=(0.1, -0.1, 0.15))
    points = board(tilt=0.0)
    measured = seen(points, camera=camera, rng=np.random.default_rng(6))
    blind = resect(field(points), measured, in_setup(ALIGNED), hold=ANGLES)
    told = resect(
        field(points),
        measured,
        in_setup(ALIGNED),
        hold=ANGLES,
        hold_std=dict.fromkeys(ANGLES, np.radians(0.1)),
    )
    assert blind.excess > 20
    assert told.excess == 1
    assert (np.abs(told.pose - true_pose(camera)) < 3 * told.std).all()


# Angles


@given(angles=st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)))
def test_both_sets_of_angles_are_of_the_same_rotation(angles):
    """M = R3(kappa) R2(phi) R1(omega) of turned axes, written out, against R."""
    rotation = rotation_matrix(*angles)
    np.testing.assert_allclose(rotation_matrix(*tunnel_angles(rotation)), rotation, atol=1e-12)
    omega, phi, kappa = textbook_angles(rotation)
    first = np.array(
        [[1, 0, 0], [0, np.cos(omega), np.sin(omega)], [0, -np.sin(omega), np.cos(omega)]]
    )
    second = np.array([[np.cos(phi), 0, -np.sin(phi)], [0, 1, 0], [np.sin(phi), 0, np.cos(phi)]])
    third = np.array(
        [[np.cos(kappa), np.sin(kappa), 0], [-np.sin(kappa), np.cos(kappa), 0], [0, 0, 1]]
    )
    m = third @ second @ first
    right, along, up = rotation.T
    np.testing.assert_allclose(m, [right, up, -along], atol=1e-12)


def test_textbook_angles_of_an_aligned_camera():
    np.testing.assert_allclose(np.degrees(textbook_angles(np.eye(3))), (90, 0, 0), atol=1e-12)


# The file


def test_a_pose_is_read_back_as_it_was_written(tmp_path):
    points = board()
    measured = seen(points, rng=np.random.default_rng(8))
    uv = measured.uv.copy()
    uv[4] += 3.0
    written = resect(
        field(points),
        ImageTargets(measured.ids, uv, measured.covariance),
        in_setup(APPROXIMATE),
        hold=("phi",),
        hold_std={"phi": 0.03},
        distance_m=1.4,
        distance_std_m=0.005,
        provenance=ResectionProvenance(targets="t.csv", measured="m.csv", setup_hash="abc"),
    )
    written.save(tmp_path / "pose.toml")
    read = SpaceResection.load(tmp_path / "pose.toml")
    for name, value in vars(written).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(read, name), value, rtol=1e-15, atol=1e-18)
        else:
            assert getattr(read, name) == value, name
    assert read.u95 == pytest.approx(written.u95)
    with pytest.raises(OutputError, match="exists already"):
        written.save(tmp_path / "pose.toml")


def test_a_setup_takes_the_pose_from_its_file(tmp_path):
    from glint_aoa.setup import load_setup

    found = resect(field(board()), seen(board()), in_setup(APPROXIMATE))
    found.save(tmp_path / "pose.toml")
    lines = [line for line in TRUE.toml.splitlines() if not line.startswith(("position", "rotat"))]
    text = "\n".join([*lines, "[calibration]", 'pose = "pose.toml"'])
    (tmp_path / "glint-aoa.toml").write_text(text)
    camera = load_setup(tmp_path / "glint-aoa.toml").camera
    np.testing.assert_allclose((*camera.position, *camera.rotation), found.pose, atol=1e-14)
    assert found.applied_to(in_setup(APPROXIMATE)).position == pytest.approx(camera.position)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("kind = ", "sort = "), "unknown key|missing"),
        (('"X_m",', '"x_m",'), "covariance: parameters must be X_m, Y_m, Z_m, omega_rad"),
        (("degrees_of_freedom = 1", "degrees_of_freedom = -1"), "fit.degrees_of_freedom: "),
        (
            ("[interior]\n", "[interior]\nnew = 1\n"),
            r"unknown key interior\.new; known keys here: parameters, s",
        ),
    ],
)
def test_a_file_that_was_edited_wrongly_is_refused(tmp_path, change, problem):
    path = tmp_path / "pose.toml"
    resect(field(board()), seen(board()), in_setup(APPROXIMATE)).save(path)
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change, 1))
    with pytest.raises(CalibrationError, match=f"pose.toml: not a space resection .*({problem})"):
        SpaceResection.load(path)


def test_a_file_that_is_missing_says_how_to_make_one(tmp_path):
    message = f"{tmp_path / 'no.toml'}: no such space resection; make one with glint-aoa calibrate"
    with pytest.raises(CalibrationError, match=re.escape(message)):
        SpaceResection.load(tmp_path / "no.toml")
