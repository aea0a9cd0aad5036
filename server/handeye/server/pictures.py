"""Pictures for people: JPEG encoding, and a look's two pictures side by side with what was found in them."""

from __future__ import annotations

import cv2
import numpy as np

from handeye.camera_bridge.driver import Image
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ImagePair, ImagePoint

_OBJECT_COLOUR = (255, 64, 64)
_HAND_COLOUR = (64, 255, 64)
_MARK_SIZE = 24
_QUALITY = 85


def jpeg(image: Image) -> bytes:
    """`image` (rows, columns, 3), red green blue, as a JPEG file."""
    done, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise ValueError(f"a picture of shape {image.shape} cannot be encoded as JPEG")
    return encoded.tobytes()


def png(image: Image) -> bytes:
    """`image` (rows, columns, 3), red green blue, as a PNG file: to the last bit what the camera saw."""
    done, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise ValueError(f"a picture of shape {image.shape} cannot be encoded as PNG")
    return encoded.tobytes()


def side_by_side(left: Image, right: Image, found: ImagePair | NotSeen) -> bytes:
    """Left and right picture next to each other as a JPEG; crosses mark the object (red) and the hand (green)."""
    left, right = left.copy(), right.copy()
    if not isinstance(found, NotSeen):
        for point, colour in ((found.object, _OBJECT_COLOUR), (found.hand, _HAND_COLOUR)):
            _mark(left, point.row, point.column, colour)
            _mark(right, point.row, right_column(point), colour)
    return jpeg(np.hstack((left, right)))


def right_column(point: ImagePoint) -> float:
    """The point's column in the right picture (disparity = left column - right column)."""
    return point.column - point.disparity


def _mark(image: Image, row: float, column: float, colour: tuple[int, int, int]) -> None:
    cv2.drawMarker(image, (round(column), round(row)), colour, cv2.MARKER_CROSS, _MARK_SIZE, 2)
