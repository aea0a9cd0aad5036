"""Where recognition breaks: pictures of the lab disturbed ever more, in picture space, until nothing is found.

Light, noise, blur, clutter and occlusion are made in the rendered pictures: exact, repeatable, and no more than a
model of what lenses, lamps and shelves do. Each disturbance has levels from none to far too much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.recognition import NotSeen, Recogniser
from handeye.modules.spaces import ImagePair, ImagePoint
from handeye.simulation.report import Picture

Image = NDArray[np.uint8]
Pair = tuple[Image, Image]
Places = tuple[tuple[float, float], tuple[float, float]]
"""(row, column) of object and hand in one picture."""

NEAR = 3.0
"""A find is right when row, column and disparity are within so many px of the undisturbed pictures' find."""

_BOX = (34.0, 22.0)  # px: half height and half width that count as the object in the lab's pictures
_THUMB = (320, 240)


@dataclass(frozen=True, slots=True)
class Disturbance:
    """One way to spoil pictures. `apply` takes a picture, the object's and the hand's place in it, a level, chance."""

    name: str
    unit: str
    levels: tuple[float, ...]
    apply: Callable[[Image, Places, float, np.random.Generator], Image]


def _as_bytes(values: NDArray[Any]) -> Image:
    return np.asarray(np.clip(np.rint(values), 0, 255), dtype=np.uint8)


def _light(image: Image, _places: Places, gain: float, _random: np.random.Generator) -> Image:
    return _as_bytes(image * gain)


def _tint(image: Image, _places: Places, warmth: float, _random: np.random.Generator) -> Image:
    return _as_bytes(image * np.array([1 + warmth, 1.0, 1 - warmth]))


def _noise(image: Image, _places: Places, deviation: float, random: np.random.Generator) -> Image:
    return _as_bytes(image + random.normal(0.0, deviation, image.shape))


def _blur(image: Image, _places: Places, deviation: float, _random: np.random.Generator) -> Image:
    return _as_bytes(cv2.GaussianBlur(image, (0, 0), deviation)) if deviation else image


def _clutter(image: Image, places: Places, count: float, random: np.random.Generator) -> Image:
    """Boxes and balls of any colour, anywhere but over object and hand."""
    crowded = image.copy()
    rows, columns = image.shape[:2]
    while count > 0:
        row, column = random.uniform((0, 0), (rows, columns))
        size, colour = random.uniform(8, 40, 2), random.integers(0, 256, 3).tolist()
        if any(abs(row - at[0]) < _BOX[0] + size[0] and abs(column - at[1]) < _BOX[0] + size[1] for at in places):
            continue
        count -= 1
        if random.random() < 0.5:
            first, second = ((int(column + sign * size[1]), int(row + sign * size[0])) for sign in (-1, 1))
            cv2.rectangle(crowded, first, second, colour, cv2.FILLED)
        else:
            axes = int(size[1]), int(size[0])
            cv2.ellipse(crowded, (int(column), int(row)), axes, 0.0, 0.0, 360.0, colour, cv2.FILLED)
    return crowded


def _occlude(image: Image, places: Places, part: float, _random: np.random.Generator) -> Image:
    """A grey board before the object's left side."""
    place, _ = places
    hidden = image.copy()
    top, bottom = (int(place[0] + sign * 1.5 * _BOX[0]) for sign in (-1, 1))
    left = int(place[1] - 1.5 * _BOX[1])
    right = int(place[1] - _BOX[1] + part * 2 * _BOX[1])
    hidden[max(0, top) : bottom, max(0, left) : max(0, right)] = 110
    return hidden if part else image


DISTURBANCES: tuple[Disturbance, ...] = (
    Disturbance("light", "× brightness", (0.4, 0.55, 0.7, 0.85, 1.0, 1.15, 1.3, 1.6), _light),
    Disturbance("tint", "warmer", (0.0, 0.05, 0.1, 0.2, 0.3), _tint),
    Disturbance("noise", "grey levels", (0.0, 5.0, 10.0, 20.0, 30.0, 45.0), _noise),
    Disturbance("blur", "px", (0.0, 1.0, 2.0, 3.0, 5.0, 8.0), _blur),
    Disturbance("clutter", "things", (0.0, 5.0, 10.0, 20.0, 40.0), _clutter),
    Disturbance("occlusion", "of the width", (0.0, 0.2, 0.35, 0.5, 0.65), _occlude),
)


def disturbed(
    recogniser: Recogniser, name: str, pairs: Sequence[Pair], random: np.random.Generator
) -> list[dict[str, Any]]:
    """Object and hand in each pair under each disturbance at each level, beside what is found undisturbed."""
    told: list[dict[str, Any]] = []
    for pair in pairs:
        at = _both(recogniser, name, pair)
        if at is None:
            continue
        for kind in DISTURBANCES:
            for level in kind.levels:
                spoilt = _spoilt(kind, level, pair, at, random)
                found = _find(recogniser, spoilt, name), _find(recogniser, spoilt, None)
                told.append(
                    {
                        "what": "disturbed",
                        "kind": kind.name,
                        "level": level,
                        "object": _judge(found[0], at.object),
                        "hand": _judge(found[1], at.hand),
                        "object_off_px": None if found[0] is None else _off(found[0], at.object),
                    }
                )
    return told


def shown(recogniser: Recogniser, name: str, pair: Pair, random: np.random.Generator) -> list[Picture]:
    """One row of left pictures for each disturbance, with what is found of the object at each level."""
    at = _both(recogniser, name, pair)
    return [] if at is None else [_row(recogniser, name, pair, at, kind, random) for kind in DISTURBANCES]


def _row(
    recogniser: Recogniser, name: str, pair: Pair, at: ImagePair, kind: Disturbance, random: np.random.Generator
) -> Picture:
    thumbs = []
    for level in kind.levels:
        spoilt = _spoilt(kind, level, pair, at, random)
        found = _find(recogniser, spoilt, name)
        thumb = np.ascontiguousarray(cv2.resize(spoilt[0], _THUMB, interpolation=cv2.INTER_AREA))
        colour = (60, 220, 60) if _judge(found, at.object) == "right" else (230, 40, 40)
        if found is not None:
            centre = (round(found.column / 2), round(found.row / 2))
            cv2.drawMarker(thumb, centre, (255, 255, 255), cv2.MARKER_CROSS, 26, 5)
            cv2.drawMarker(thumb, centre, colour, cv2.MARKER_CROSS, 26, 2)
        cv2.putText(thumb, f"{level:g}", (6, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.8, colour, 2)
        thumbs.append(thumb)
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(np.hstack(thumbs), cv2.COLOR_RGB2BGR))
    caption = f"Disturbed by {kind.name} ({kind.unit}): green where the object is found right, red where it is not."
    return Picture(jpeg.tobytes(), caption)


def _spoilt(kind: Disturbance, level: float, pair: Pair, at: ImagePair, random: np.random.Generator) -> Pair:
    left, right = (
        kind.apply(image, (_in_picture(at.object, share), _in_picture(at.hand, share)), level, random)
        for image, share in zip(pair, (0.0, 1.0), strict=True)
    )
    return left, right


def _in_picture(point: ImagePoint, share: float) -> tuple[float, float]:
    """(row, column) in the left (0) or in the right picture (1)."""
    return point.row, point.column - share * point.disparity


def _both(recogniser: Recogniser, name: str, pair: Pair) -> ImagePair | None:
    try:
        return recogniser.see(*pair, name)
    except NotSeen:
        return None


def _find(recogniser: Recogniser, pair: Pair, name: str | None) -> ImagePoint | None:
    try:
        return (recogniser.see_hand(*pair) if name is None else recogniser.see_object(*pair, name))[0]
    except NotSeen:
        return None


def _off(found: ImagePoint, expected: ImagePoint) -> float:
    return float(np.abs(found.array() - expected.array()).max())


def _judge(found: ImagePoint | None, expected: ImagePoint) -> str:
    """ "right", "missed" (which recognition says itself), or "wrong" (which it does not)."""
    if found is None:
        return "missed"
    return "right" if _off(found, expected) <= NEAR else "wrong"
