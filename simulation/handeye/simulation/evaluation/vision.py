"""Guided recognition (thesis 4.2.7, Tables 4.3 and 4.4): how far off the guides are, what a window saves, what breaks.

The coordinator is shown ten grasps. What its cameras saw meanwhile also goes, over HTTP, to a recogniser of the same
kind in this process, which is then timed and judged on pictures of scenes never shown.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.client.errors import HandeyeError
from handeye.modules.guided import REACHES, GuidedRecogniser
from handeye.modules.marker import Marker
from handeye.modules.object_model import ObjectModel
from handeye.modules.recognition import NotSeen, Recogniser, Windows
from handeye.modules.silhouette import rough_places
from handeye.modules.spaces import ImagePoint
from handeye.modules.window import Image, Window
from handeye.robot_bridge.driver import unwatched
from handeye.simulation import grasping, kinematics, lessons, rig
from handeye.simulation.collecting import collect
from handeye.simulation.evaluation import disturbing
from handeye.simulation.evaluation.disturbing import Pair
from handeye.simulation.evaluation.outcome import Figure, average, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.gripper import MARKER_ID, TOOL_FROM_MARKER
from handeye.simulation.objects import CUPS, ObjectSpec, Shape
from handeye.simulation.places import Place, Purpose, draw, generator
from handeye.simulation.profile import Profile
from handeye.simulation.report import Picture
from handeye.simulation.teacher import FRESH, Teacher, near, registration_places
from handeye.simulation.trying import Trials

TASK, OBJECT = "grasp", "blue cup"
TAUGHT = 10
BLUNDER = 50.0
"""px: a guess farther off than this must have been flagged."""

_NEW_CUPS = 3
_SHAPES: tuple[Shape, ...] = ("cup", "tumbler", "mug")
_DISTURBED = 3  # scenes of each seed
_ROUNDS = 3  # timings of one look, of which the fastest counts
_ASIDE = 0.12  # rad that the head turns away at least, and as much again at most

Array = NDArray[np.float64]


class Onlooker:
    """Sees what the coordinator's cameras see, and recognises as it does."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.recogniser = Recogniser(MARKER_ID)
        self.marker = Marker(MARKER_ID)
        self.guided = GuidedRecogniser(self.recogniser)

    def pair(self, not_older_than: float = 0.0) -> Pair:
        """What both cameras see."""
        client = self.site.client
        return client.image("left", not_older_than).pixels, client.image("right", not_older_than).pixels

    def look(self) -> Pair:
        """What they see now that all is at rest."""
        with self.site.client.control("referee") as control:
            now = control.state().world_time
            control.advance(FRESH)
        return self.pair(now)

    def learn(self, spec: ObjectSpec, seed: int) -> None:
        """Has an object shown, to the coordinator too, and learns it from the same kind of pictures."""
        site = self.site
        site.lab.reset(seed)
        backgrounds = [*self.look(), *self.look()]
        examples: list[Image] = []
        for number, place in enumerate(registration_places()):
            site.lab.place(spec, place, yaw=0.5 + 1.3 * number)
            examples += self.look()
        self.guided.register(spec.name, ObjectModel.learn(backgrounds, examples))


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    cv2.setNumThreads(1)  # in this process: times are of one thread
    onlooker, cup = Onlooker(site), CUPS[OBJECT]
    _teach(onlooker, cup, seed)
    told: list[Trial] = []
    seen: list[Pair] = []
    random = np.random.default_rng([seed, 17])
    grasps = Trials(site.client, site.lab, cup, TASK, site.stack.check)
    with site.progress("scenes and grasps", trials) as advance:
        for place in draw(seed, Purpose.TESTING, trials):
            told += _scenes(onlooker, cup, place, random, seen)
            judged = grasps.at(len(told), place).trial
            told.append({"what": "grasp", "passed": judged.passed, "failure": judged.failure})
            advance()
    told += _new_cups(onlooker, seed, random)
    with site.progress("disturbing pictures", 1) as advance:
        told += disturbing.disturbed(onlooker.recogniser, OBJECT, seen[:: max(1, len(seen) // _DISTURBED)], random)
        if not pictures:
            pictures += disturbing.shown(onlooker.recogniser, OBJECT, seen[0], random)
        advance()
    return told


def _teach(onlooker: Onlooker, cup: ObjectSpec, seed: int) -> None:
    """CSS and ten grasps for the coordinator; each look also teaches the onlooker's guides."""
    site = onlooker.site
    collect("CSS", site.lab, site.client, seed, site.progress)
    onlooker.learn(cup, seed)
    teacher = Teacher(site.robot, site.lab, site.client, lessons.grasp(cup), TASK, unwatched)
    teacher.register_objects(seed)
    motions = generator(seed, Purpose.MOTIONS)

    def watch() -> None:
        onlooker.guided.see(*onlooker.pair(), cup.name)

    with site.progress("ten demonstrations", TAUGHT) as advance:
        for place in draw(seed, Purpose.TEACHING, TAUGHT):
            teacher.demonstrate((place,), motions, watch)
            advance()
    while onlooker.guided.due:
        onlooker.guided.rebuild()
    site.client.train(TASK)


def _scenes(
    onlooker: Onlooker, cup: ObjectSpec, place: Place, random: np.random.Generator, seen: list[Pair]
) -> list[Trial]:
    """Looks at one place of the cup: without it, arm parked, arm on its way or near it, and with the head turned."""
    site = onlooker.site
    site.lab.reset(place.seed)
    told = [_absent(onlooker, cup)]
    site.lab.place(cup, (place.x, place.y), place.yaw)
    told += _judged(onlooker, cup, "arm parked", onlooker.look())
    with site.client.control("referee") as control:
        control.move_to_joints(_posture(site, cup, random))
    seen.append(onlooker.look())
    told += _judged(onlooker, cup, "arm near", seen[-1])
    with site.client.control("referee") as control:
        head = control.state(), site.client.head()
        turn = random.choice((-1, 1), 2) * random.uniform(_ASIDE, 2 * _ASIDE, 2)
        control.turn_head(head[1].pan + turn[0], head[1].tilt + turn[1])
    told += _judged(onlooker, cup, "head turned", onlooker.look())
    return told


def _posture(site: Site, cup: ObjectSpec, random: np.random.Generator) -> Array:
    """A posture as they come in a grasp of the cup where it stands: on the way to it, or around its goals."""
    truth = site.lab.world().object(cup.name).pose.position
    goals = grasping.solve_chain(truth[:2], height=float(truth[2]))
    kind = random.integers(3)
    if kind == 0:
        return np.asarray(grasping.PARK + random.uniform() * (goals["approach"] - grasping.PARK))
    goal, scatter = (("approach", lessons.AROUND_APPROACH), ("grasp", lessons.AROUND_GRASP))[kind - 1]
    return near(scatter.draw(kinematics.forward(goals[goal]), random)[0], goals[goal])


def _absent(onlooker: Onlooker, cup: ObjectSpec) -> Trial:
    """Without the cup: whether that is flagged, and whether something else is taken for it."""
    pair = onlooker.look()
    guesses = onlooker.guided.guesses(*pair, cup.name)
    try:
        onlooker.guided.see_object(*pair, cup.name)
    except NotSeen:
        return {"what": "absent", "flagged": guesses is None or not guesses.trusted, "found": False}
    return {"what": "absent", "flagged": guesses is None or not guesses.trusted, "found": True}


def _judged(onlooker: Onlooker, cup: ObjectSpec, scene: str, pair: Pair) -> list[Trial]:
    """Cup and hand in one pair: guess against find, times, and the find against truth."""
    truth = onlooker.site.lab.world()
    points = {
        cup.name: truth.object(cup.name).pose.position,
        None: (truth.tool.matrix() @ TOOL_FROM_MARKER)[:3, 3],
    }
    head = onlooker.site.client.head()
    told = []
    for name, point in points.items():
        trial: Trial = {"what": "look", "scene": scene, "thing": "hand" if name is None else "object"}
        guesses = onlooker.guided.guesses(*pair, name)
        trial["flagged"] = guesses is None or not guesses.trusted
        try:
            found = _whole(onlooker, pair, name)
        except NotSeen as missing:
            told.append({**trial, "found": False, "reason": str(missing)})
            continue
        trial |= {"found": True, "truth_px": (found.array() - _projected(point, head.pan, head.tilt)).tolist()}
        if guesses is not None:
            trial["support"] = min(guesses.left.support, guesses.right.support)
            trial["off_px"] = [
                float(np.hypot(guesses.left.row - found.row, guesses.left.column - found.column)),
                float(np.hypot(guesses.right.row - found.row, guesses.right.column - found.column + found.disparity)),
            ]
        trial |= _timed(onlooker, pair, name, found)
        told.append(trial)
    return told


def _whole(onlooker: Onlooker, pair: Pair, name: str | None, windows: Windows | None = None) -> ImagePoint:
    """What is found without guides."""
    recogniser = onlooker.recogniser
    found = recogniser.see_hand(*pair, windows) if name is None else recogniser.see_object(*pair, name, windows)
    return found[0]


def _search(onlooker: Onlooker, pair: Pair, name: str | None, windows: Windows) -> None:
    """Detection alone, without the alignment to a fraction of a pixel, which costs the same in a window."""
    for picture, window in zip(pair, windows, strict=True):
        if name is None:
            onlooker.marker.detects(picture, window)
        else:
            model = onlooker.recogniser.model(name)
            rough_places(picture, model.object_probability, model.templates, window)


def _timed(onlooker: Onlooker, pair: Pair, name: str | None, found: ImagePoint) -> Trial:
    """ms of one look, by turns: at whole pictures, at windows, the guides alone, and all that guided looking is.

    Of the processor's time: others work on the same cores.
    """
    shape = pair[0].shape
    left = Window.around(found.row, found.column, REACHES[0] * shape[1], shape)
    right = Window.around(found.row, found.column - found.disparity, REACHES[0] * shape[1], shape)
    assert left is not None and right is not None  # noqa: S101, PT018 # it was found there
    guided = onlooker.guided
    whole = Window.whole(shape)
    calls: dict[str, Callable[[], object]] = {
        "search_whole_ms": partial(_search, onlooker, pair, name, (whole, whole)),
        "search_window_ms": partial(_search, onlooker, pair, name, (left, right)),
        "whole_ms": partial(_whole, onlooker, pair, name),
        "window_ms": partial(_whole, onlooker, pair, name, (left, right)),
        "guides_ms": partial(guided.guesses, *pair, name),
        "guided_ms": partial(guided.see_hand, *pair) if name is None else partial(guided.see_object, *pair, name),
    }
    least = dict.fromkeys(calls, math.inf)
    for _ in range(_ROUNDS):
        for key, call in calls.items():
            started = time.thread_time()
            call()
            least[key] = min(least[key], 1e3 * (time.thread_time() - started))
    return least


def _projected(point: Array, pan: float, tilt: float) -> Array:
    """(row, column, disparity) in px where the lab's cameras truly show a point (3,) in m, world frame."""
    left, right = (rig.project(point, name, pan, tilt, Profile.named("default")) for name in ("left", "right"))
    return np.array([left[0], left[1], left[1] - right[1]])


def _new_cups(onlooker: Onlooker, seed: int, random: np.random.Generator) -> list[Trial]:
    """Cups of random colour, shape and size: learned by showing, then looked for where they were not shown."""
    told: list[Trial] = []
    with onlooker.site.progress("cups never seen before", _NEW_CUPS) as advance:
        for number in range(_NEW_CUPS):
            shape = _SHAPES[number % len(_SHAPES)]
            colour = tuple(random.uniform(0.05, 0.95, 3).tolist())
            height = float(random.uniform(0.08, 0.11))
            spec = ObjectSpec(f"cup {number}", shape, float(random.uniform(0.028, 0.036)), height, color=colour)
            told += [
                {"seed_of_cup": number, "color": colour, "shape": shape} | each for each in _new(onlooker, spec, seed)
            ]
            advance()
    return told


def _new(onlooker: Onlooker, spec: ObjectSpec, seed: int) -> list[Trial]:
    try:
        onlooker.learn(spec, seed)
    except (ValueError, HandeyeError) as error:
        return [{"what": "new cup", "found": False, "reason": str(error)}]
    told: list[Trial] = []
    for place in draw(seed, Purpose.TESTING, 2):
        site = onlooker.site
        site.lab.reset(place.seed)
        site.lab.place(spec, (place.x, place.y), place.yaw)
        pair, head = onlooker.look(), site.client.head()
        truth = _projected(site.lab.world().object(spec.name).pose.position, head.pan, head.tilt)
        try:
            off = _whole(onlooker, pair, spec.name).array() - truth
            told.append({"what": "new cup", "found": True, "truth_px": off.tolist()})
        except NotSeen as missing:
            told.append({"what": "new cup", "found": False, "reason": str(missing)})
    return told


def _figures(told: Sequence[Trial]) -> tuple[Figure, ...]:
    looks = [each for each in told if each["what"] == "look"]
    ordinary = [each for each in looks if each["scene"] != "head turned"]
    turned = [each for each in looks if each["scene"] == "head turned"]
    absent = [each for each in told if each["what"] == "absent"]
    new = [each for each in told if each["what"] == "new cup"]
    guessed = [each for each in looks if "off_px" in each]
    blunders = [max(each["off_px"]) > BLUNDER and not each["flagged"] for each in guessed]
    figures = [
        share(
            "vision-guided grasp (approach, grasp and lift)",
            [all(each["passed"].values()) for each in told if each["what"] == "grasp"],
            98.0,
            "approach 100 %, grasp 80 %",
        ),
        share(
            f"no guess more than {BLUNDER:g} px off unflagged", [not each for each in blunders], 100.0, "200 px, twice"
        ),
        share("ordinary looks not flagged", [not each["flagged"] for each in ordinary], 98.0),
        share("found in ordinary looks", [each["found"] for each in ordinary]),
        share("found with the head turned", [each["found"] for each in turned]),
        share("flagged with the head turned (hand)", [each["flagged"] for each in turned if each["thing"] == "hand"]),
        share("flagged where the cup is not there", [each["flagged"] for each in absent]),
        share("nothing taken for a cup that is not there", [not each["found"] for each in absent]),
        share("cups never seen before: found", [each["found"] for each in new]),
    ]
    for thing in ("object", "hand"):
        off = [each["off_px"] for each in ordinary if each["thing"] == thing and "off_px" in each]
        figures.append(average(f"guess to find, {thing}", np.ravel(off), "px"))
        found = np.array([each["truth_px"] for each in ordinary if each["thing"] == thing and each["found"]])
        # The silhouette's centre is not quite the cup's: a constant difference says nothing.
        scatter = np.abs(found - found.mean(axis=0)).max(axis=1)
        figures.append(average(f"scatter of the find around the truth, {thing}", scatter, "px"))
        figures += _times([each for each in looks if each["thing"] == thing and "whole_ms" in each], thing)
    return (*figures, *_disturbances(told))


def _times(looks: Sequence[Trial], thing: str) -> list[Figure]:
    """Ratios of times within one look, and the ms themselves; one look is at two pictures."""
    trusted = [each for each in looks if not each["flagged"]]
    times = {
        key: np.array([each[key] for each in trusted])
        for key in ("search_whole_ms", "search_window_ms", "whole_ms", "window_ms", "guides_ms", "guided_ms")
    }
    whole, searched = times["whole_ms"], times["search_whole_ms"] / times["search_window_ms"]
    thesis = {"object": "164 / 37 s", "hand": "155 / 32 s"}[thing]
    return [
        average(f"detection alone, whole picture / window, {thing}", searched, "×", thesis=thesis, least=4.0),
        average(f"with alignment, whole picture / window, {thing}", whole / times["window_ms"], "×"),
        average(f"whole picture / guided with the guides' own time, {thing}", whole / times["guided_ms"], "×"),
        average(f"whole pictures, {thing}", whole, "ms"),
        average(f"windows, {thing}", times["window_ms"], "ms"),
        average(f"guides alone, {thing}", times["guides_ms"], "ms"),
        average(f"guided, {thing}", times["guided_ms"], "ms"),
    ]


def _disturbances(told: Sequence[Trial]) -> list[Figure]:
    """For each disturbance and level: object found right; and how often something else was taken for it."""
    spoilt = [each for each in told if each["what"] == "disturbed"]
    figures = []
    for kind in disturbing.DISTURBANCES:
        for level in kind.levels:
            at = [each for each in spoilt if each["kind"] == kind.name and each["level"] == level]
            for thing in ("object", "hand") if at else ():
                right = [each[thing] == "right" for each in at]
                figures.append(share(f"{thing} found under {kind.name} {level:g} {kind.unit}", right))
    return [
        *figures,
        share("nothing wrong taken for the object, disturbed", [each["object"] != "wrong" for each in spoilt]),
    ]


def _histograms(told: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    looks = [each for each in told if each["what"] == "look" and "off_px" in each and each["scene"] != "head turned"]
    return {
        f"Guess to find in single pictures, {thing}, in px": tuple(
            float(off) for each in looks if each["thing"] == thing for off in each["off_px"]
        )
        for thing in ("object", "hand")
    }


EVALUATION = Evaluation(
    "vision", "Guided recognition (RSS): four MDF guides, windows, and where it breaks", _measure, _figures, _histograms
)
