"""The steps of a camera calibration, one after the other."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.camera import _checks as checks
from calibration.camera._board_detection import NotFound
from calibration.camera._board_order import put_in_order
from calibration.camera._bundle import Observation
from calibration.camera._fit import ORDERS, Fit, cleaned, first_fit, with_order
from calibration.camera._start import first_state
from calibration.camera.boards import Board, BoardImage
from glint_aoa.errors import CalibrationError

Floats = NDArray[np.float64]

_PLAIN = 2  # k1 and k2
_MOST_OUT = 0.5  # of the images: then nobody knows which half is right


def ordered_images(
    images: Sequence[BoardImage], board: Board, aspect: float
) -> tuple[BoardImage, ...]:
    """Put the corners of all images in the board's order; those that make no board go."""
    return tuple(_ordered(image, board, aspect) if image.found else image for image in images)


def _ordered(image: BoardImage, board: Board, aspect: float) -> BoardImage:
    put = put_in_order(image.corner, image.uv, board, aspect)
    if isinstance(put, NotFound):
        nothing = np.empty(0, np.int64), np.empty((0, 2))
        return BoardImage(image.name, image.source, *nothing, note=put.reason)
    return dataclasses.replace(image, corner=put.corner, note=put.note) if put.note else image


def fitted_images(
    images: Sequence[BoardImage],
    board: Board,
    *,
    sensor: tuple[int, int],
    aspect: float,
    hold: Sequence[str],
    place_std: float,
    order: int | None,
) -> Fit:
    """Fit the camera to the images in which the board was found, bad ones left out.

    The lens model is the one asked for, but k1 and k2 at least, or else the richest that the images
    determine: what a poorer one leaves must not pass for a bad image.

    Raises
    ------
    CalibrationError
        If no lens model is determined, or half of the images disagree with the others.
    """
    observations = [Observation(image.corner, image.uv) for image in images]
    radius = float(np.median([image.radius for image in images])) if board.is_circles else 0.0
    orders = [each for each in reversed(ORDERS) if order is None or each <= max(order, _PLAIN)]
    try:
        first = first_fit(
            observations,
            board.places,
            radius=radius,
            sensor=sensor,
            aspect=aspect,
            hold=hold,
            order=orders[0],
        )
    except np.linalg.LinAlgError:
        raise checks.undetermined(
            first_state(observations, board.places, sensor, aspect), "camera at all"
        ) from None
    why: CalibrationError | None = None
    for each in orders:
        try:
            fit = with_order(first, each, hold, settle=True, place_std=place_std)
            fit = cleaned(fit, checks.LEAST_IMAGES)
            checks.refuse_undetermined(fit.adjusted, sensor)
        except CalibrationError as error:
            why = error
        except np.linalg.LinAlgError:
            why = why or checks.undetermined(first.adjusted.state, "camera at all")
        else:
            _refuse_discord(fit, images)
            return fit
    raise why or CalibrationError("no lens model fits")


def _refuse_discord(fit: Fit, images: Sequence[BoardImage]) -> None:
    if len(fit.out) > _MOST_OUT * len(images):
        number, reason = next(iter(fit.out.items()))
        raise CalibrationError(
            f"{len(fit.out)} of {len(images)} images disagree with the others; first "
            f"{images[number].name}: {reason}"
        )
