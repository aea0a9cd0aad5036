"""Recognition in a window beside the whole picture: time of one look at one picture, as ratios within one run.

    python -m benchmarks.vision

Pictures are drawn, 640 × 480: a cup, a marker on an arm, a table. Searching is told apart from aligning to a fraction
of a pixel, which costs the same in a window. The guide's own time is beside them: an MDF tree of as many pictures as it
keeps. One thread and its processor time, calls by turns, medians.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.guide import Guide, Imagination, reduced
from handeye.modules.marker import Marker
from handeye.modules.object_model import ObjectModel
from handeye.modules.silhouette import rough_places
from handeye.modules.spaces import HeadAngles
from handeye.modules.window import Image, Window

SEED = 41  # nothing was tuned on it
SIZE = (480, 640)
REACH = 40  # px, the narrow window
SCENES, ROUNDS = 20, 15
HEAD = HeadAngles(0.0, 0.0)

Floats = NDArray[np.float64]


def draw(random: np.random.Generator, cup: Floats | None, hand: Floats | None) -> Image:
    """A cup and a marker at (row, column) px on a table, with noise."""
    canvas = np.full((*SIZE, 3), (205, 200, 190), np.uint8)
    if hand is not None:
        row, column = (int(value) for value in hand)
        cv2.rectangle(canvas, (column - 30, 0), (column + 30, row - 30), (90, 92, 95), cv2.FILLED)
        square = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 36)
        plate = cv2.copyMakeBorder(square, 6, 6, 6, 6, cv2.BORDER_CONSTANT, value=255)
        canvas[row - 24 : row + 24, column - 24 : column + 24] = plate[..., None]
    if cup is not None:
        row, column = (int(value) for value in cup)
        cv2.rectangle(canvas, (column - 21, row - 33), (column + 21, row + 33), (25, 60, 190), cv2.FILLED)
    smooth = cv2.GaussianBlur(canvas, (0, 0), 0.6)
    return np.asarray(np.clip(np.rint(smooth + random.normal(0, 1.5, canvas.shape)), 0, 255), dtype=np.uint8)


def places(random: np.random.Generator) -> tuple[Floats, Floats]:
    return random.uniform((240, 100), (430, 540)), random.uniform((60, 100), (180, 540))


def roughly(place: Floats, random: np.random.Generator) -> Window | None:
    row, column = place + random.uniform(-20, 20, 2)
    return Window.around(float(row), float(column), REACH, SIZE)


def by_turns(calls: dict[str, Callable[[], object]], took: dict[str, list[float]]) -> None:
    for _ in range(ROUNDS):
        for name, call in calls.items():
            started = time.thread_time()
            call()
            took.setdefault(name, []).append(1e3 * (time.thread_time() - started))


def taught(pictures: Sequence[NDArray[np.uint8]], at: Sequence[Floats], reach: float) -> Guide:
    guide = Guide((*SIZE, 3), Imagination(2, reach))
    for number, (picture, place) in enumerate(zip(pictures, at, strict=True)):
        guide.teach(picture, float(place[0]), float(place[1]), number, HEAD)
    guide.rebuild()
    return guide


def main() -> None:
    cv2.setNumThreads(1)
    random = np.random.default_rng(SEED)
    shown = [np.array(place) for place in ((260, 150), (400, 500), (300, 420), (380, 220))]
    model = ObjectModel.learn([draw(random, None, None)], [draw(random, place, None) for place in shown])
    marker = Marker(7)
    lessons = [places(random) for _ in range(320)]
    small = [reduced(draw(random, *lesson)) for lesson in lessons]
    cup_guide = taught([model.likeness(each) for each in small], [cup for cup, _ in lessons], 1 / 4)
    hand_guide = taught([grey(each) for each in small], [hand for _, hand in lessons], 1 / 16)
    took: dict[str, list[float]] = {}
    for _ in range(SCENES):
        cup, hand = places(random)
        picture = draw(random, cup, hand)
        at_cup, at_hand = (roughly(place, random) for place in (cup, hand))
        assert at_cup is not None
        by_turns(
            {
                "object, search, whole": partial(search, model, picture, Window.whole(picture.shape)),
                "object, search, window": partial(search, model, picture, at_cup),
                "object, found, whole": partial(model.locate, picture),
                "object, found, window": partial(model.locate, picture, at_cup),
                "object, guide": partial(guessed, cup_guide, picture, model.likeness),
                "hand, search, whole": partial(marker.detects, picture),
                "hand, search, window": partial(marker.detects, picture, at_hand),
                "hand, found, whole": partial(marker.locate, picture),
                "hand, found, window": partial(marker.locate, picture, at_hand),
                "hand, guide": partial(guessed, hand_guide, picture, grey),
            },
            took,
        )
    report({name: np.array(values) for name, values in took.items()})


def guessed(guide: Guide, picture: Image, view: Callable[[Image], NDArray[np.uint8]]) -> object:
    return guide.guess(view(reduced(picture)), HEAD)


def search(model: ObjectModel, picture: Image, window: Window) -> list[Floats]:
    return rough_places(picture, model.object_probability, model.templates, window)


def grey(picture: Image) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def report(took: dict[str, Floats]) -> None:
    for name, values in took.items():
        print(f"{name:26} {np.median(values):7.2f} ms")
    for what in ("object, search", "object, found", "hand, search", "hand, found"):
        whole, window = took[f"{what}, whole"], took[f"{what}, window"]
        guide = took[f"{what.partition(',')[0]}, guide"]
        print(
            f"{what}: whole / window {np.median(whole / window):.2f} ×, "
            f"with the guide's own time {np.median(whole / (window + guide)):.2f} ×"
        )


if __name__ == "__main__":
    main()
