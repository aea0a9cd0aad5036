"""The person who helps with collecting: holds a grid or a ball where the cameras see it, and knows where that is.

As the teacher it may use truth, in a process of its own. The coordinator hears of it only where the grid's
intersections are (4.2.3); the ball it has to find by itself.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.client import ApiError, Client
from handeye.rpc.errors import InvalidArgument
from handeye.simulation import rig
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import BALL, GRID, GRID_INTERSECTIONS, ObjectSpec, grid_points
from handeye.simulation.pose import Pose

Array = NDArray[np.float64]

FRESH = 0.08
"""World time in s that passes before each look, so that the cameras have a picture of what is held."""

ASIDE = (math.pi / 2, 0.0)
"""(pan, tilt) in rad: away from arm and table, where there is room to hold a grid."""

_HEAD_PAN, _HEAD_TILT = (-1.0, 1.0), (-0.9, 0.25)  # rad: from where the ball is fixated
_LEAST_HEIGHT = 0.06  # m above the table
_TURNED = np.array([0.15, 0.35, 0.35])  # rad: how far a grid is rolled, pitched and yawed at most
_UNSEEN = 0.25  # of the views of a grid may not be seen
_PATIENCE = 20  # balls in a row that came to nothing
_PASSING = ("not_seen", "not_fixated", "unavailable", "deadline_exceeded")
"""Why a ball may come to nothing and the next one not: the arm is before it, or the machine is too busy."""
_EXAMPLES = 8  # a ball is lit otherwise from each side
_WHOLE = 60.0  # px from the border in which an example lies at least
_CUP_EXAMPLES = ((0.55, -0.10), (0.75, 0.10), (0.82, -0.02), (0.62, 0.05))  # m, on the table, near and far


@dataclass(frozen=True, slots=True)
class GridView:
    """How a grid is held before the camera: its centre (right, down, depth) in m, its roll, pitch and yaw in rad."""

    spec: ObjectSpec
    centre: tuple[float, float, float]
    turned: tuple[float, float, float]
    every: int = 1
    """Only every so manyth row and column is learned."""

    def camera_from_grid(self) -> Array:
        """(4, 4); unturned it faces the camera, its x to the right and its y up."""
        roll, pitch, yaw = self.turned
        pose = np.eye(4)
        pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ _turn(2, roll) @ _turn(0, pitch) @ _turn(1, yaw)
        pose[:3, 3] = self.centre
        return pose

    def points(self) -> Array:
        """(9, 9, 3) its intersections in the left camera's frame, row by row as the camera sees them."""
        pose = self.camera_from_grid()
        points: Array = grid_points(self.spec) @ pose[:3, :3].T + pose[:3, 3]
        return points.reshape(GRID_INTERSECTIONS, GRID_INTERSECTIONS, 3)


def thesis_views(random: np.random.Generator) -> list[GridView]:
    """The thesis's nine views: the 40 × 40 cm grid at 85 to 125 cm, every 5 cm, and not quite straight."""
    middle = rig.rig().baseline / 2
    return [
        GridView(GRID, (middle, 0.0, depth), tuple(random.normal(0.0, 0.06, 3).tolist()))
        for depth in np.linspace(0.85, 1.25, 9)
    ]


def volume_views(random: np.random.Generator, depths: int = 11) -> list[GridView]:
    """Views of smaller grids that fill what both cameras see between 50 cm and 1.5 m."""
    camera, baseline = rig.rig().camera, rig.rig().baseline
    half_width, half_height = camera.width / 2 / camera.focal_length, camera.height / 2 / camera.focal_length
    views = []
    for least in np.linspace(0.5, 1.5, depths):
        for across, down in product((0.0, 0.5, 1.0), (0.0, 1.0)):
            # No two at one depth, and none straight: planes that lie in each other's way tell most.
            depth = least + random.uniform(0.0, 1.0 / depths)
            spec = replace(GRID, radius=0.08 if depth < 0.8 else 0.15)
            room = 1.3 * spec.radius
            left, right = baseline - half_width * depth + room, half_width * depth - room
            below = half_height * depth - room
            centre = (float(np.interp(across, (0, 1), (left, right))), (2 * down - 1) * below, depth)
            views.append(GridView(spec, centre, tuple(random.uniform(-_TURNED, _TURNED).tolist()), every=2))
    return views


class Experimenter:
    """Helps a coordinator of a running stack to collect samples."""

    def __init__(self, lab: LabClient, client: Client, seed: int) -> None:
        self._lab = lab
        self._client = client
        self._seed = seed

    def show_grid(self, views: Sequence[GridView], on_view: Callable[[], None]) -> Counter[str]:
        """Has CSS learn from each of the views; returns how many were rejected, by reason.

        `ApiError` "not_seen" when too many of them were not seen.
        """
        rejected: Counter[str] = Counter()
        self._lab.reset(self._seed)
        with self._client.control("experimenter") as control:
            head = control.turn_head(*ASIDE)
            world_from_camera = np.linalg.inv(rig.left_from_world(head.pan, head.tilt))
            for view in views:
                self._lab.hold(view.spec, Pose.from_matrix(world_from_camera @ view.camera_from_grid()))
                held = control.state().world_time
                control.advance(FRESH)
                try:
                    self._client.collect_grid_view(view.points(), every=view.every, not_older_than=held)
                except ApiError as error:
                    rejected["not seen"] += 1
                    if error.code != "not_seen" or rejected.total() > _UNSEEN * len(views):
                        raise
                on_view()
        self._lab.remove(GRID.name)
        return rejected

    def register_ball(self) -> None:
        """Shows the coordinator what the ball looks like, from poses of the head all over its range."""
        self._lab.reset(self._seed)
        shown = in_vain = 0
        for pan, tilt, place in self.balls(self._seed, _WHOLE):
            with self._client.control("experimenter") as control:
                empty = control.turn_head(pan, tilt).world_time
                control.advance(FRESH)
                self._client.add_background(BALL.name, empty)
                try:
                    self.hang_ball(place)
                except InvalidArgument:  # the arm is there
                    continue
                held = control.state().world_time
                control.advance(FRESH)
                try:
                    self._client.add_example(BALL.name, held)
                except ApiError:  # the arm is before it
                    in_vain += 1
                    if in_vain == _PATIENCE:
                        raise
                    continue
                finally:
                    self.take_ball()
            shown += 1
            if shown == _EXAMPLES:
                break

    def register_cup(self, spec: ObjectSpec) -> None:
        """Shows the coordinator what a cup looks like, near and far on the table."""
        self._lab.reset(self._seed)
        with self._client.control("experimenter") as control:
            for _ in range(2):
                empty = control.state().world_time
                control.advance(FRESH)
                self._client.add_background(spec.name, empty)
            for place in _CUP_EXAMPLES:
                self._lab.place(spec, place)
                shown = control.state().world_time
                control.advance(FRESH)
                self._client.add_example(spec.name, shown)
        self._lab.remove(spec.name)

    def show_ball(
        self, count: int, nearly_centred: int, on_fixation: Callable[[], None], done: int = 0
    ) -> Counter[str]:
        """Has SCS learn from `count` fixations of the ball, the last `nearly_centred` of them from their ends only.

        `done` of them it has learned from before. Returns how many were rejected, by reason; `JobFailed` when the ball
        is not fixated time and again.
        """
        rejected: Counter[str] = Counter()
        in_vain = 0
        self._lab.reset(self._seed)
        for pan, tilt, place in self.balls(self._seed + done):  # otherwise it would be shown where it was
            if done >= count:
                break
            if not self.present(pan, tilt, place):
                continue
            keep: Literal["first", "last"] = "first" if done < count - nearly_centred else "last"
            job = self._client.collect_fixation(BALL.name, keep=keep)
            if job.succeeded:
                done, in_vain = done + 1, 0
                on_fixation()
                continue
            code = "" if job.error is None else job.error.code
            rejected[code.replace("_", " ")] += 1
            in_vain += 1
            if code not in _PASSING or in_vain == _PATIENCE:
                job.raise_for_failure()
        self.take_ball()
        return rejected

    def present(self, pan: float, tilt: float, place: Array) -> bool:
        """Hangs the ball at a place, and turns the head to (pan, tilt) in rad; False when the arm is there."""
        try:
            self.hang_ball(place)
        except InvalidArgument:
            return False
        with self._client.control("experimenter") as control:
            control.turn_head(pan, tilt)
        return True

    def hang_ball(self, place: Array) -> None:
        """Hangs the ball's middle at (3,) in m, world frame; `InvalidArgument` when something is there."""
        self._lab.hold(BALL, Pose(place, np.array([0.0, 0.0, 0.0, 1.0])))

    def take_ball(self) -> None:
        """Takes the ball away."""
        self._lab.remove(BALL.name)

    def balls(self, seed: int, margin: float = rig.MARGIN) -> Iterator[tuple[float, float, Array]]:
        """(pan, tilt) of the head, and a place of the ball in both pictures: evenly over pictures, depths and tilts.

        The ball's middle is at least `margin` px from the pictures' borders.
        """
        camera = rig.rig().camera
        for row, column, near, lean, aside in evenly(5, seed):
            pan, tilt = np.interp(aside, (0, 1), _HEAD_PAN), np.interp(lean, (0, 1), _HEAD_TILT)
            depth = np.interp(near, (0, 1), (0.85, 1.25))
            down = (row * camera.height - camera.principal_row) / camera.focal_length * depth
            right = (column * camera.width - camera.principal_column) / camera.focal_length * depth
            world_from_camera = np.linalg.inv(rig.left_from_world(pan, tilt))
            place = world_from_camera[:3, :3] @ [right, down, depth] + world_from_camera[:3, 3]
            if place[2] > _LEAST_HEIGHT and rig.in_view(place, pan, tilt, margin):
                yield float(pan), float(tilt), place


def evenly(dimensions: int, seed: int) -> Iterator[Array]:
    """Points of the unit cube, spread evenly from the first on, without end.

    The additive recurrence of Roberts ("The unreasonable effectiveness of quasirandom sequences", 2018).
    """
    ratio = 2.0
    for _ in range(40):  # the root of x^(d + 1) = x + 1
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    step = ratio ** -np.arange(1.0, dimensions + 1.0)
    point = np.random.default_rng(seed).random(dimensions)
    while True:
        yield point
        point = (point + step) % 1.0


def _turn(axis: int, angle: float) -> Array:
    """Rotation (3, 3) by `angle` rad about one of the axes."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.eye(3)
    others = [i for i in range(3) if i != axis]
    turn[np.ix_(others, others)] = [[c, -s], [s, c]]
    return turn
