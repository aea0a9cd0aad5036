"""The five-module chain in a closed loop: the hand goes to a point that was seen, from any pose of the head.

A ball is hung where the hand is to be, seen once, and taken away; then the hand goes there. The referee measures how
far the middle of the hand's marker is from where the ball's was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handeye.client import ApiError
from handeye.client.models import ReachJob
from handeye.rpc.errors import InvalidArgument, Unreachable
from handeye.simulation import grasping, kinematics, rig
from handeye.simulation.collecting import collect
from handeye.simulation.evaluation.outcome import Figure, average, count, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.experimenter import FRESH
from handeye.simulation.gripper import marker_place
from handeye.simulation.report import Picture

LOWER, UPPER = np.array([0.35, -0.25, 0.05]), np.array([0.85, 0.25, 0.35])
"""Where the tool centre point is to come, in m, world frame: 50 × 50 × 30 cm."""

_NEAR = 1.05  # m from the camera
_NEAR_MM, _FAR_MM = 2.0, 4.0
_ASIDE = (0.15, 0.15)  # rad that the head looks beside the target at most
_ONE_LOOK_EVERY = 3

Array = NDArray[np.float64]


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Collects for all modules, then reaches for places that the hand can come to."""
    for module in ("CSS", "SCS", "AJS", "CAS"):
        collect(module, site.lab, site.client, seed, site.progress)
    random = np.random.default_rng([seed, 1])
    told: list[Trial] = []
    unseen = 0
    with site.progress("reaching", trials) as advance:
        while len(told) < trials:
            try:
                trial = _trial(site, random, len(told), pictures)
            except ApiError as error:
                if error.code != "not_seen":
                    raise
                unseen += 1  # the arm is before the ball
                continue
            if trial is not None:
                told.append({**trial, "unseen_before": unseen})
                unseen = 0
                advance()
    return told


def _trial(site: Site, random: np.random.Generator, number: int, pictures: list[Picture]) -> Trial | None:
    """One reach, and now and then one more by a single look; None when what was drawn cannot be tried.

    `ApiError` "not_seen" when the ball is not seen.
    """
    goal, start = _posture(random), _posture(random)
    if goal is None or start is None:
        return None
    place = marker_place(kinematics.forward(goal))
    pan, tilt = np.add(towards(place), random.uniform(-1.0, 1.0, 2) * _ASIDE).tolist()
    site.lab.reset(int(random.integers(2**31)))
    try:
        with site.client.control("referee") as control:
            control.move_to_joints(start)
            head = control.turn_head(pan, tilt)
            shown = place, marker_place(site.lab.world().tool.matrix())
            if not all(rig.in_view(point, head.pan, head.tilt) for point in shown):
                return None
            site.experimenter.hang_ball(place)
            hung = control.state().world_time
            control.advance(FRESH)
            seen = site.client.look("ball", hung)
            site.experimenter.take_ball()
    except (InvalidArgument, Unreachable):  # the arm is there, or the ball would be out of the lab
        return None
    job = site.client.reach(seen.point)
    told = {
        "place": place.tolist(),
        "pan": pan,
        "tilt": tilt,
        "depth": float(np.linalg.norm(place - _camera(pan, tilt))),
        "miss_mm": _miss(site, place),
        "looks": len(job.result.looks) if job.result is not None else 0,
        "state": job.state,
        "failure": "" if job.succeeded else job.failure,
        "seen_mm": [1e3 * look.away for look in job.result.looks] if job.result is not None else [],
    }
    if number < 3:
        pictures += _pictures(site, job, number)
    if number % _ONE_LOOK_EVERY == 0:
        with site.client.control("referee") as control:
            control.move_to_joints(start)
        single = site.client.reach(seen.point, one_look=True)
        told["one_look_mm"] = _miss(site, place) if single.succeeded else None
    return told


def _figures(told: Sequence[Trial]) -> tuple[Figure, ...]:
    near = [each for each in told if each["depth"] < _NEAR]
    far = [each for each in told if each["depth"] >= _NEAR]

    def within(trials: Sequence[Trial], bound: float) -> list[bool]:
        return [each["state"] == "succeeded" and each["miss_mm"] <= bound for each in trials]

    figures = [
        share(f"within {bound:g} mm {where} {_NEAR:g} m", within(trials, bound), 95.0, "never done")
        for trials, bound, where in ((near, _NEAR_MM, "nearer than"), (far, _FAR_MM, "beyond"))
        if trials
    ]
    done = [each["miss_mm"] for each in told if each["state"] == "succeeded"]
    return (
        *figures,
        average("mean miss of the reaches that ended well", done, "mm"),
        average("mean miss by one look", _by_one_look(told), "mm"),
        average("looks", [each["looks"] for each in told], "looks", 6.0),
        count("balls that were not seen, and not tried", sum(each["unseen_before"] for each in told), len(told)),
    )


def _by_one_look(told: Sequence[Trial]) -> tuple[float, ...]:
    """Misses in mm, where it was tried and not refused."""
    return tuple(each["one_look_mm"] for each in told if each.get("one_look_mm") is not None)


def _histograms(told: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {
        "Miss of single reaches, closed loop, in mm": tuple(each["miss_mm"] for each in told),
        "Miss by one look, in mm": _by_one_look(told),
    }


def _pictures(site: Site, job: ReachJob, number: int) -> list[Picture]:
    looks = job.result.looks if job.result is not None else ()
    marks = "left and right picture; red cross: where the hand is to be, green cross: where it is seen"
    return [
        Picture(
            site.client.picture(look.picture),
            f"Trial {number + 1}, look {look.number + 1}, {1e3 * look.away:.1f} mm away: {marks}.",
        )
        for look in dict.fromkeys((*looks[:1], *looks[-1:]))
    ]


def _posture(random: np.random.Generator) -> Array | None:
    try:
        x, y, z = random.uniform(LOWER, UPPER)
        return grasping.solve(grasping.grasp_pose(np.array([x, y]), z))
    except Unreachable:
        return None


def _miss(site: Site, place: Array) -> float:
    """How far the marker is from `place`, in mm."""
    return float(1e3 * np.linalg.norm(marker_place(site.lab.world().tool.matrix()) - place))


def _camera(pan: float, tilt: float) -> Array:
    """Where the left camera is, (3,) in m, world frame."""
    return np.asarray(np.linalg.inv(rig.left_from_world(pan, tilt))[:3, 3], np.float64)


def towards(place: Array) -> tuple[float, float]:
    """(pan, tilt) in rad of a head that looks towards a place (3,) in m, world frame."""
    head = rig.rig().head
    x, y, z = place - np.array(head.position)
    turn = math.atan2(y, x) - head.heading
    pan = (turn + math.pi) % (2 * math.pi) - math.pi
    return pan, math.atan2(z, math.hypot(x, y))


EVALUATION = Evaluation(
    "reach",
    "Reaching by the five-module chain (CSS, CAS, AJS), closed loop, from random poses of the head",
    _measure,
    _figures,
    _histograms,
)
