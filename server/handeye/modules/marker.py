"""Finding the hand by its ArUco marker, to about a hundredth of a pixel.

Detection only says which square it is; the reference point comes from aligning the whole printed pattern with the
picture. Four refined corners have several times its noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.alignment import HOMOGRAPHY, FloatArray, Pattern, align
from handeye.modules.window import Image, Window

_MODULE = 12  # samples of the pattern along one module
_MARGIN = 0.5  # modules of the white margin that take part
_MIN_CORRELATION = 0.8
_AROUND = 48  # px searched beyond a window: half of a marker twice as large as any in the lab, and its surroundings
_LEAST_PERIMETER = 0.02  # of a marker's outline, as a share of the whole picture's longer side


@dataclass(frozen=True, slots=True)
class MarkerSighting:
    """Centre (row, column) in px, outline (4, 2) as (row, column) in px, correlation of pattern and picture.

    The outline goes round the part of the white margin that was compared, half a module wide.
    """

    row: float
    column: float
    outline: FloatArray
    correlation: float


class Marker:
    """One ArUco marker of a dictionary, looked for in colour pictures."""

    def __init__(self, marker_id: int = 7, dictionary: int = cv2.aruco.DICT_4X4_50) -> None:
        """`marker_id` of one of OpenCV's predefined dictionaries; ValueError when the dictionary has no such marker."""
        printed = cv2.aruco.getPredefinedDictionary(dictionary)
        if not 0 <= marker_id < len(printed.bytesList):
            raise ValueError(f"marker {marker_id} is not in the dictionary: it has 0 to {len(printed.bytesList) - 1}")
        self.marker_id = marker_id
        self._dictionary = printed
        modules = printed.markerSize + 2
        side = round((modules + 2 * _MARGIN) * _MODULE)
        self._half = modules / (modules + 2 * _MARGIN)  # the black square's half side in pattern units
        square = cv2.aruco.generateImageMarker(printed, marker_id, modules * _MODULE)
        border = (side - square.shape[0]) // 2
        self._pattern = Pattern.of(
            cv2.copyMakeBorder(square, border, border, border, border, cv2.BORDER_CONSTANT, value=255).astype(
                np.float32
            )
        )

    def locate(self, image: Image, window: Window | None = None) -> MarkerSighting | None:
        """The marker in `image` (rows, columns, 3); None when it is not seen whole.

        With a `window`, only there and around it; what is found is what is found in the whole picture.
        """
        searched, grey, corners = self._search(image, window)
        if corners is None:
            return None
        h = self._half
        square = np.array([[-h, -h], [h, -h], [h, h], [-h, h]], np.float32)
        start = np.asarray(cv2.getPerspectiveTransform(square, corners), dtype=np.float64)
        found = align(grey.astype(np.float32), self._pattern, start, HOMOGRAPHY, subsamples=3)
        if found is None or found.correlation < _MIN_CORRELATION:
            return None
        row, column = found.centre
        corner = np.array([searched.top, searched.left])
        return MarkerSighting(row + searched.top, column + searched.left, found.outline() + corner, found.correlation)

    def detects(self, image: Image, window: Window | None = None) -> bool:
        """Whether the marker is there: the search that `locate` begins with."""
        return self._search(image, window)[2] is not None

    def _search(
        self, image: Image, window: Window | None
    ) -> tuple[Window, NDArray[np.uint8], NDArray[np.float32] | None]:
        """The part that is searched, grey, and the marker's corners in it."""
        searched = Window.whole(image.shape) if window is None else window.grown(_AROUND, image.shape)
        grey = np.asarray(cv2.cvtColor(searched.of(image), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
        return searched, grey, self._detect(grey, max(image.shape))

    def _detect(self, grey: NDArray[np.uint8], longer_side: int) -> NDArray[np.float32] | None:
        """Corners (4, 2) as (x, y), clockwise from the pattern's top left; a second try on the doubled picture.

        `longer_side` of the whole picture that `grey` is a part of.
        """
        detector = cv2.aruco.ArucoDetector(self._dictionary, _parameters(longer_side / max(grey.shape)))
        for scale in (1, 2):
            picture = grey if scale == 1 else cv2.resize(grey, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
            corners, ids, _ = detector.detectMarkers(picture)
            for quad, found in zip(corners, () if ids is None else ids.ravel(), strict=False):
                if found == self.marker_id:
                    # Index of a doubled picture's pixel to that of the picture: centres, not corners, count.
                    return np.asarray((quad[0] + 0.5) / scale - 0.5, dtype=np.float32)
        return None


def _parameters(share: float) -> cv2.aruco.DetectorParameters:
    """How a picture is searched whose longer side is 1 / `share` of the whole one's: for the same sizes as there."""
    parameters = cv2.aruco.DetectorParameters()
    # The marker is 25-40 px wide: modules of 4-6 px, so small squares have to pass and cells be read nearly whole.
    parameters.minMarkerPerimeterRate = _LEAST_PERIMETER * share
    parameters.adaptiveThreshWinSizeMin = 5
    parameters.adaptiveThreshWinSizeMax = 29
    parameters.adaptiveThreshWinSizeStep = 12
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    return parameters
