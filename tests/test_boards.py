"""Boards in pictures: drawn ones through OpenCV's detectors, mixed-up orders, messages."""

import re

import cv2
import numpy as np
import pytest
from board_pictures import Lens, chessboard, circles, photograph, pose, sheet_of

from calibration.camera._board_order import put_in_order
from calibration.camera.boards import Board, BoardImage, find_board, find_boards
from calibration.photographs import Photograph
from glint_aoa.errors import CalibrationError

LENS = Lens(0.0175, sensor=(376, 120), principal=(190.3, 58.2))
SQUARE = 0.03
CHESS = Board("chessboard", 6, 4, SQUARE)
DISCS = Board("circles", 5, 4, 0.04)
STAGGERED = Board("asymmetric-circles", 3, 7, 0.025)
CHARUCO = Board("charuco", 7, 5, SQUARE, marker=0.02, dictionary="4X4_50")
TILT = {"direction_deg": 35.0, "turn_deg": 5.0, "distance": 1.35}


def rng():
    return np.random.default_rng(8)


def middle_of(board):
    return np.ptp(board.places[:, :2], axis=0) / 2


def charuco_sheet(*, columns=7, rows=5, legacy=False, name="DICT_4X4_50"):
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    printed = cv2.aruco.CharucoBoard((columns, rows), SQUARE, 0.02, dictionary)
    printed.setLegacyPattern(legacy)
    picture = printed.generateImage((200 * columns, 200 * rows))
    drawn = sheet_of(picture, (SQUARE * columns, SQUARE * rows))
    # its first inner corner lies a square inside the sheet
    return lambda x, y, soft: drawn(x + SQUARE, y + SQUARE, soft)


def seen(pattern, board, *, tilt=25.0, lens=LENS, **how):
    """Photograph a board; returns the picture as read, and where its corners truly are."""
    place = {key: how.pop(key, value) for key, value in TILT.items()}
    at = how.pop("at", (0.0, 0.0))
    turn = pose(tilt, middle=middle_of(board), at=at, **place)
    field = photograph(pattern, lens, *turn, rng(), **how)
    parity = how.get("parity", 0)
    picture = Photograph("board.png", "board.png", field.astype(np.float32), parity)
    return picture, lens.project(board.places, *turn)


def error_of(found, truth, board):
    """Of each corner [pixels]; a board may be listed from either end where both look alike."""
    other = board.places[::-1]
    ends = [truth[found.corner], truth[len(other) - 1 - found.corner]]
    return min((found.uv - end for end in ends), key=lambda off: np.abs(off).max())


class TestFinding:
    @pytest.mark.parametrize("parity", [0, 1])
    def test_chessboard_in_a_field(self, parity):
        """Line v of an odd field is half a line lower; corners are good to some thousandths."""
        picture, truth = seen(chessboard(6, 4, SQUARE), CHESS, parity=parity)
        found = find_board(picture, CHESS, aspect=LENS.aspect)
        assert found.note == ""
        assert found.corner.size == 24
        off = error_of(found, truth, CHESS)
        assert np.sqrt(np.mean(off**2, axis=0)) == pytest.approx([0, 0], abs=0.01)
        assert np.abs(off.mean(axis=0)).max() < 0.004

    def test_it_beats_opencvs_own_refinement_there(self):
        picture, truth = seen(chessboard(6, 4, SQUARE), CHESS)
        found = find_board(picture, CHESS, aspect=LENS.aspect)
        start = truth.astype(np.float32).reshape(-1, 1, 2)
        grey = picture.grey.astype(np.uint8)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)
        refined = cv2.cornerSubPix(grey, start.copy(), (7, 3), (-1, -1), criteria)
        theirs = np.sqrt(np.mean((refined.reshape(-1, 2) - truth) ** 2))
        ours = np.sqrt(np.mean(error_of(found, truth, CHESS) ** 2))
        assert ours < 0.3 * theirs

    def test_square_pixels_and_a_window_of_the_sensor(self):
        lens = Lens(0.0175, (11.7e-6, 11.7e-6), (376, 282), (190.3, 137.0))
        picture, truth = seen(chessboard(6, 4, SQUARE), CHESS, lens=lens)
        cut = Photograph("a", "a", picture.grey[40:], first_line=40, first_column=0)
        found = find_board(cut, CHESS, aspect=1.0)
        off = error_of(found, truth, CHESS)
        assert np.abs(off).max() < 0.02

    def test_circles(self):
        """Centroids are those of the ellipses, which are not the images of the centres."""
        picture, truth = seen(circles(5, 4, 0.04, 0.012), DISCS)
        found = find_board(picture, DISCS, aspect=LENS.aspect)
        assert found.corner.size == 20
        assert found.radius == pytest.approx(0.012, rel=0.01)
        assert np.abs(error_of(found, truth, DISCS)).max() < 0.06

    def test_asymmetric_circles(self):
        pattern = circles(3, 7, 0.025, 0.008, staggered=True)
        picture, truth = seen(pattern, STAGGERED, turn_deg=95.0)
        found = find_board(picture, STAGGERED, aspect=LENS.aspect)
        assert found.corner.size == 21
        assert found.radius == pytest.approx(0.008, rel=0.015)
        # this grid has only one end that is like its first
        assert np.abs(found.uv - truth[found.corner]).max() < 0.06

    @pytest.mark.parametrize("legacy", [False, True])
    def test_charuco(self, legacy):
        board = Board("charuco", 7, 6, SQUARE, marker=0.02, dictionary="4X4_50")
        pattern = charuco_sheet(rows=6, legacy=legacy)
        picture, truth = seen(pattern, board, tilt=15.0)
        found = find_board(picture, board, aspect=LENS.aspect)
        assert found.corner.size >= 29
        assert np.abs(found.uv - truth[found.corner]).max() < 0.06

    def test_charuco_that_leaves_the_picture(self):
        picture, truth = seen(charuco_sheet(), CHARUCO, tilt=15.0, at=(0.14, 0.0))
        found = find_board(picture, CHARUCO, aspect=LENS.aspect)
        assert 6 <= found.corner.size < 24
        assert np.abs(found.uv - truth[found.corner]).max() < 0.06

    def test_a_corner_under_a_reflection_is_left_out(self):
        picture, truth = seen(chessboard(6, 4, SQUARE), CHESS)
        u, v = np.rint(truth[9]).astype(int)
        picture.grey[v - 1 : v + 2, u - 1 : u + 4] = 255
        found = find_board(picture, CHESS, aspect=LENS.aspect)
        assert found.corner.size == 23
        assert found.note == (
            "1 of its corners left out: cut by the edge, covered, or not like a corner's"
        )
        assert np.abs(error_of(found, truth, CHESS)).max() < 0.02

    def test_many_pictures(self):
        picture, _ = seen(chessboard(6, 4, SQUARE), CHESS)
        dark = Photograph("dark.png", "dark.png", np.full((120, 376), 7.0, np.float32))
        first, second = find_boards([picture, dark], CHESS, aspect=LENS.aspect)
        assert first.found
        assert not second.found


class TestNotFound:
    def reason(self, grey, board=CHESS):
        found = find_board(Photograph("a", "a", grey.astype(np.float32)), board, aspect=LENS.aspect)
        assert not found.found
        assert found.uv.shape == (0, 2)
        return found.note

    def test_squares_counted_instead_of_corners(self):
        picture, _ = seen(chessboard(6, 4, SQUARE), CHESS)
        assert self.reason(picture.grey, Board("chessboard", 7, 5, SQUARE)) == (
            "a chessboard of 6 x 4 inner corners is seen, not of 7 x 5: count where squares meet, "
            "not the squares; give --board chessboard:6x4:..."
        )

    def test_no_board(self):
        grey = 100 + 60 * np.sin(np.arange(376) / 9) * np.ones((120, 1))
        assert self.reason(grey) == (
            "no chessboard of 6 x 4 inner corners is seen; show it whole with a white margin of a "
            "square around it, evenly lit and sharp"
        )

    def test_no_contrast(self):
        assert self.reason(np.full((120, 376), 40.0)) == (
            "the picture is of one grey, 40 to 40; light the board and expose longer"
        )

    def test_over_exposed(self):
        grey = np.full((120, 376), 255.0)
        grey[:40] = 20
        assert self.reason(grey) == (
            "more than half of the picture is over-exposed; expose for the board's white"
        )

    def test_margins_too_narrow(self):
        picture, _ = seen(charuco_sheet(), CHARUCO, tilt=15.0)
        narrow = Board("charuco", 7, 5, SQUARE, marker=0.028, dictionary="4X4_50")
        assert re.fullmatch(
            r"its margins between markers and squares are only 1\.\d pixels wide and 0\.\d high; "
            "come nearer, or use a board with larger ones",
            self.reason(picture.grey, narrow),
        )

    def test_too_few_circles(self):
        picture, _ = seen(circles(5, 4, 0.04, 0.012), DISCS)
        assert self.reason(picture.grey, Board("circles", 6, 5, 0.04)) == (
            "20 circles of the 6 x 5 (30) are seen; show the whole grid, evenly lit and sharp, its "
            "circles 10 pixels or more across"
        )

    def test_circles_that_make_no_such_grid(self):
        picture, _ = seen(circles(5, 4, 0.04, 0.012), DISCS)
        assert self.reason(picture.grey, Board("circles", 7, 2, 0.04)) == (
            "20 circles are seen, but no grid of 7 x 2 (14); count again, and clear the background "
            "of round marks"
        )

    def test_markers_of_another_dictionary(self):
        picture, _ = seen(charuco_sheet(), CHARUCO, tilt=15.0)
        other = Board("charuco", 7, 5, SQUARE, marker=0.02, dictionary="7X7_50")
        assert self.reason(picture.grey, other) == (
            "no marker of the dictionary 7X7_50 is seen; check the board's dictionary, and show "
            "its markers 20 pixels large or more, evenly lit and sharp"
        )


class TestOrder:
    GRID = np.arange(24).reshape(4, 6)
    UV = LENS.project(CHESS.places, *pose(25, middle=middle_of(CHESS), **TILT))

    def order(self, listed, board=CHESS, uv=None):
        points = (self.UV if uv is None else uv)[np.ravel(listed)]
        return put_in_order(np.arange(len(points)), points, board, LENS.aspect)

    def test_the_right_order_is_kept(self):
        put = self.order(self.GRID)
        np.testing.assert_array_equal(put.corner, np.arange(24))
        assert put.note == ""

    def test_a_board_listed_from_its_other_end_is_a_board(self):
        put = self.order(self.GRID[::-1, ::-1])
        np.testing.assert_array_equal(put.corner, np.arange(24))
        assert put.note == ""

    @pytest.mark.parametrize(
        ("listed", "what"),
        [
            (GRID.T, "rows and columns exchanged"),
            (GRID.T[:, ::-1], "rows and columns exchanged"),
            (GRID[::-1], ""),
            (GRID[:, ::-1], ""),
        ],
    )
    def test_mixed_up_rows_and_columns_are_put_right(self, listed, what):
        put = self.order(listed)
        assert put.note.startswith(f"corner order repaired: {what}")
        # either end may come first
        right = np.ravel(listed)
        assert np.array_equal(put.corner, right) or np.array_equal(put.corner, right[::-1])

    def test_an_asymmetric_grid_has_only_one_right_end(self):
        uv = LENS.project(
            STAGGERED.places, *pose(25, middle=middle_of(STAGGERED), **TILT | {"turn_deg": 90})
        )
        put = self.order(np.arange(21)[::-1], STAGGERED, uv)
        np.testing.assert_array_equal(put.corner, np.arange(21)[::-1])
        assert put.note == "corner order repaired: turned by 180 degrees"

    @pytest.mark.parametrize("kind", ["two swapped", "a row too far", "shuffled"])
    def test_what_makes_no_board_is_said_so(self, kind):
        listed = self.GRID.copy()
        if kind == "two swapped":
            listed[1, [2, 3]] = listed[1, [3, 2]]
        elif kind == "a row too far":
            listed = np.roll(listed, 1, axis=0)
        else:
            listed = rng().permutation(24)
        assert self.order(listed).reason == (
            "its corners are not in the order of a board of 6 x 4; show the whole board from its "
            "front, flat and evenly lit"
        )

    def test_a_strong_barrel_is_still_a_board(self):
        lens = Lens(0.004, (1e-5, 1e-5), (640, 480), (320.0, 240.0), (-0.3, 0.1, 0, 0, 0))
        board = Board("chessboard", 9, 6, SQUARE)
        uv = lens.project(board.places, *pose(10, middle=middle_of(board), distance=0.19))
        put = put_in_order(np.arange(54), uv, board, 1.0)
        np.testing.assert_array_equal(put.corner, np.arange(54))


class TestBoard:
    @pytest.mark.parametrize(
        ("text", "board"),
        [
            ("chessboard:9x6:30mm", Board("chessboard", 9, 6, 0.03)),
            ("chessboard: 9 x 6 : 1.2 in", Board("chessboard", 9, 6, 0.03048)),
            ("circles:7x6:36mm", Board("circles", 7, 6, 0.036)),
            ("asymmetric-circles:4x11:2cm", Board("asymmetric-circles", 4, 11, 0.02)),
            (
                "charuco:11x8:30mm:22mm:DICT_5X5_250",
                Board("charuco", 11, 8, 0.03, marker=0.022, dictionary="5X5_250"),
            ),
        ],
    )
    def test_descriptions(self, text, board):
        parsed = Board.parse(text)
        assert parsed.spacing == pytest.approx(board.spacing)
        again = Board.parse(str(parsed))
        assert (again.kind, again.shape, again.dictionary) == (
            board.kind,
            board.shape,
            board.dictionary,
        )

    def test_places(self):
        np.testing.assert_allclose(
            Board("circles", 3, 2, 1.0).places[:, :2],
            [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]],
        )
        np.testing.assert_allclose(
            Board("asymmetric-circles", 2, 3, 1.0).places[:, :2],
            [[0, 0], [2, 0], [1, 1], [3, 1], [0, 2], [2, 2]],
        )
        assert len(CHARUCO.places) == 24

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (
                "checkers:9x6:30mm",
                'board "checkers:9x6:30mm": "checkers" is not a kind of board; give one such as '
                "chessboard:9x6:30mm, circles:7x6:36mm, asymmetric-circles:4x11:20mm, "
                "charuco:11x8:30mm:22mm:5x5_250",
            ),
            (
                "chessboard:9x6",
                'board "chessboard:9x6": it has not as many parts as chessboard:9x6:30mm',
            ),
            (
                "chessboard:54:30mm",
                'board "chessboard:54:30mm": "54" is not columns x rows; chessboard:9x6:30mm',
            ),
            (
                "chessboard:9x6:30",
                "board \"chessboard:9x6:30\": '30' is not a quantity in m; chessboard:9x6:30mm",
            ),
            (
                "chessboard:9x1:30mm",
                "a board of 9 x 1 corners or circles is too small; use one of 3 x 3 at least, "
                "better 9 x 6",
            ),
            (
                "circles:101x6:30mm",
                "a board of 101 x 6 corners or circles is too fine to be seen; use one of 100 x "
                "100 at most, better 9 x 6",
            ),
            (
                "chessboard:9x6:0mm",
                "a board's spacing of 0 m cannot be; it must be greater than zero",
            ),
            (
                "charuco:9x6:20mm:30mm:4x4_50",
                "a ChArUco board's markers of 0.03 m must be smaller than its squares of 0.02 m",
            ),
        ],
    )
    def test_descriptions_that_cannot_be_are_refused(self, text, message):
        with pytest.raises(CalibrationError, match=re.escape(message)):
            Board.parse(text)

    def test_an_unknown_dictionary(self):
        board = Board("charuco", 7, 5, SQUARE, marker=0.02, dictionary="5X5_251")
        picture, _ = seen(charuco_sheet(), CHARUCO)
        with pytest.raises(
            CalibrationError,
            match=re.escape('"5x5_251" is not a dictionary of markers; give one of 4x4_100, '),
        ):
            find_board(picture, board)

    def test_a_dictionary_with_too_few_markers(self):
        board = Board("charuco", 30, 30, SQUARE, marker=0.02, dictionary="5X5_50")
        picture, _ = seen(charuco_sheet(), CHARUCO)
        message = (
            "a board of 30 x 30 squares has 450 markers, and 5x5_50 only 50; give the board's own "
            "dictionary and size"
        )
        with pytest.raises(CalibrationError, match=f"^{message}$"):
            find_board(picture, board)

    def test_pixels_that_cannot_be(self):
        picture = Photograph("a", "a", np.zeros((40, 40), np.float32))
        with pytest.raises(
            CalibrationError,
            match=re.escape("pixels 235 times as high as wide cannot be; check the pixel pitch"),
        ):
            find_board(picture, CHESS, aspect=235.0)


def test_a_board_image_knows_whether_the_board_was_found():
    nothing = BoardImage("a", "a", np.empty(0, np.int64), np.empty((0, 2)))
    assert not nothing.found
    assert BoardImage("a", "a", np.arange(2), np.zeros((2, 2))).found
