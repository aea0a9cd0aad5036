"""Recognition and segmentation (RSS): a stereo pair → I, the image points of the object and of the hand.

From the two pictures alone. The cameras' axes are parallel, so a point has nearly the same row in both pictures (lens
distortion leaves a few px) and lies farther to the right in the left one: what breaks this is not the same thing.
"""

from __future__ import annotations

import numpy as np

from handeye.modules.marker import Marker, MarkerSighting
from handeye.modules.object_model import ObjectModel, Sighting
from handeye.modules.spaces import ROW_TOLERANCE, HandPoint, ImagePair, ImagePoint
from handeye.modules.window import Image, Window

Windows = tuple[Window, Window]
"""Where to search in the left and in the right picture."""

_SIZE_TOLERANCE = 1.3


class NotSeen(Exception):
    """Object or hand is not to be found in a picture; the message says which, where, and what to do."""


class HandNotSeen(NotSeen):
    """It is the hand that is not to be found."""


class Recogniser:
    """Finds the registered objects and the hand's marker in stereo pairs."""

    def __init__(self, marker_id: int = 7) -> None:
        """`marker_id`: the hand's ArUco marker, of the dictionary 4X4_50."""
        self._marker = Marker(marker_id)
        self._models: dict[str, ObjectModel] = {}

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the registered objects, sorted."""
        return tuple(sorted(self._models))

    def register(self, name: str, model: ObjectModel) -> None:
        """Makes an object known under `name`; an earlier one of that name is replaced."""
        self._models[name] = model

    def forget(self, name: str) -> None:
        """Makes an object unknown; does nothing when it is."""
        self._models.pop(name, None)

    def see(self, left: Image, right: Image, name: str) -> ImagePair:
        """Where object `name` and the hand are in a stereo pair, pictures of shape (rows, columns, 3), red green blue.

        The object's reference point is the centre of its silhouette, the hand's the centre of its marker. `NotSeen`
        when either is hidden, cut or absent in one of the pictures; `KeyError` for a name that was never registered;
        `ValueError` when the pictures differ in size.
        """
        self.model(name)
        hand, hand_confidence = self.see_hand(left, right)
        found, object_confidence = self.see_object(left, right, name)
        return ImagePair(found, hand, object_confidence, hand_confidence)

    def see_hand(self, left: Image, right: Image, windows: Windows | None = None) -> tuple[HandPoint, float]:
        """The hand's marker and the confidence in [0, 1], searched for in the pictures or in windows of them.

        Raises as `see` does.
        """
        _check_sizes(left, right)
        at_left, at_right = windows or (None, None)
        in_left, in_right = self._hand_in(left, "left", at_left), self._hand_in(right, "right", at_right)
        if not _same_point(in_left, in_right):
            raise HandNotSeen(
                f"the hand is not seen: marker {self._marker.marker_id} lies at {_place(in_left)} in the left picture "
                f"and at {_place(in_right)} in the right one, which cannot be the same marker; take away any second "
                "marker with this number and check that the cameras are not exchanged"
            )
        disparities = in_left.outline[:, 1] - in_right.outline[:, 1]
        outline = tuple(map(tuple, np.column_stack([in_left.outline, disparities]).tolist()))
        point = HandPoint(in_left.row, in_left.column, in_left.column - in_right.column, outline)
        return point, min(in_left.correlation, in_right.correlation)

    def model(self, name: str) -> ObjectModel:
        """What object `name` looks like; `KeyError` for a name that was never registered."""
        model = self._models.get(name)
        if model is None:
            raise KeyError(f"no object named {name!r} is registered; known are {', '.join(self.objects) or 'none'}")
        return model

    def _hand_in(self, image: Image, picture: str, window: Window | None) -> MarkerSighting:
        found = self._marker.locate(image, window)
        if found is None:
            raise HandNotSeen(
                f"the hand is not seen in the {picture} picture: its marker (number {self._marker.marker_id}) is "
                "hidden, out of view or too oblique; move the hand or what stands before it so that the whole marker "
                "with its white margin faces both cameras"
            )
        return found

    def see_object(
        self, left: Image, right: Image, name: str, windows: Windows | None = None
    ) -> tuple[ImagePoint, float]:
        """The object's silhouette and the confidence in [0, 1], searched for in the pictures or in windows of them.

        Raises as `see` does.
        """
        _check_sizes(left, right)
        model = self.model(name)
        at_left, at_right = windows or (None, None)
        in_left = _whole(model.locate(left, at_left), name, "left")
        in_right = _whole(model.locate(right, at_right), name, "right")
        pairs = [(a, b) for a in in_left for b in in_right if _same_point(a, b) and _same_size(a, b)]
        if not pairs:
            raise NotSeen(
                f"object {name!r} is not seen: what looks like it at {_place(in_left[0])} in the left picture and at "
                f"{_place(in_right[0])} in the right one is not the same thing; take similar things out of view or "
                "register the object again"
            )
        seen_left, seen_right = max(pairs, key=lambda pair: pair[0].score + pair[1].score)
        best_left = model.completed(left, seen_left, seen_right)
        best_right = model.completed(right, seen_right, seen_left)
        point = ImagePoint(best_left.row, best_left.column, best_left.column - best_right.column)
        return point, min(best_left.score, best_right.score)


def _check_sizes(left: Image, right: Image) -> None:
    if left.shape != right.shape:
        raise ValueError(f"left and right picture differ in size: {left.shape} and {right.shape}")


def _whole(sightings: list[Sighting], name: str, picture: str) -> list[Sighting]:
    """The sightings that the picture's border does not cut; `NotSeen` when there is none."""
    if not sightings:
        raise NotSeen(
            f"object {name!r} is not seen in the {picture} picture: nothing there has its colours and its shape; put "
            "it into view, clear what hides it, or register it again if the light has changed"
        )
    whole = [sighting for sighting in sightings if not sighting.cut]
    if not whole:
        raise NotSeen(
            f"object {name!r} is not seen in the {picture} picture: it is cut by the picture's border; turn the head "
            "towards it or move it towards the middle of the view"
        )
    return whole


def _place(sighting: MarkerSighting | Sighting) -> str:
    return f"row {sighting.row:.0f}, column {sighting.column:.0f}"


def _same_point(left: MarkerSighting | Sighting, right: MarkerSighting | Sighting) -> bool:
    return abs(left.row - right.row) <= ROW_TOLERANCE and left.column > right.column


def _same_size(left: Sighting, right: Sighting) -> bool:
    return all(1 / _SIZE_TOLERANCE < a / b < _SIZE_TOLERANCE for a, b in zip(left.size, right.size, strict=True))
