"""Guided recognition (thesis 4.2.7, Tables 4.3 and 4.4): how far off the guides are, what a window saves, what breaks.

The coordinator is shown ten grasps. What its cameras saw meanwhile also goes, over HTTP, to a recogniser of the same
kind in this process, which is then timed and judged on pictures of scenes never shown.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.client.errors import HandeyeError
from handeye.modules.recognition import NotSeen
from handeye.robot_bridge.driver import unwatched
from handeye.simulation import grasping, kinematics, lessons, rig
from handeye.simulation.collecting import collect
from handeye.simulation.evaluation import disturbing
from handeye.simulation.evaluation.disturbing import Pair
from handeye.simulation.evaluation.onlooker import Onlooker
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.evaluation.vision_figures import figures, histograms
from handeye.simulation.gripper import TOOL_FROM_MARKER
from handeye.simulation.objects import CUPS, ObjectSpec, Shape
from handeye.simulation.places import Place, Purpose, draw, generator
from handeye.simulation.profile import Profile
from handeye.simulation.report import Picture
from handeye.simulation.teacher import Teacher, near
from handeye.simulation.trying import Trials

TASK, OBJECT = "grasp", "blue cup"
TAUGHT = 10

_NEW_CUPS = 3
_SHAPES: tuple[Shape, ...] = ("cup", "tumbler", "mug")
_DISTURBED = 3  # scenes of each seed
_ASIDE = 0.12  # rad that the head turns away at least, and as much again at most

Array = NDArray[np.float64]


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
        onlooker.guided.see(*onlooker.pair(), cup.name, onlooker.head)

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
    guesses = onlooker.guided.guesses(*pair, cup.name, onlooker.head)
    try:
        onlooker.guided.see_object(*pair, cup.name, onlooker.head)
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
        guesses = onlooker.guided.guesses(*pair, name, onlooker.head)
        trial["flagged"] = guesses is None or not guesses.trusted
        try:
            found = onlooker.find(pair, name)
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
        trial |= onlooker.timed(pair, name, found)
        told.append(trial)
    return told


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
            off = onlooker.find(pair, spec.name).array() - truth
            told.append({"what": "new cup", "found": True, "truth_px": off.tolist()})
        except NotSeen as missing:
            told.append({"what": "new cup", "found": False, "reason": str(missing)})
    return told


EVALUATION = Evaluation(
    "vision", "Guided recognition (RSS): four MDF guides, windows, and where it breaks", _measure, figures, histograms
)
