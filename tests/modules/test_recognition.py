"""RSS: stereo pairs → image points of object and hand, on drawn pictures and on the lab's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.modules.object_model import ObjectModel
from handeye.modules.recognition import NotSeen, Recogniser

from .conftest import Artist, Image, Thing, marker_warp

Floats = NDArray[np.float64]
View = tuple[list[Thing], float | None]
"""What stands in a picture, and the column of the marker's centre."""

BLUE, RED = (25, 60, 190), (200, 30, 30)
CUP = Thing(150, 170, (24, 16), (BLUE,))
OTHER = Thing(150, 170, (24, 16), (RED,))


@pytest.fixture(scope="module")
def recogniser() -> Recogniser:
    artist = Artist()
    places = ((0, 0), (30, 40), (-20, -60), (10, 80))
    model = ObjectModel.learn([artist.picture()], [artist.picture([CUP.moved(*place)]) for place in places])
    result = Recogniser(7)
    result.register("cup", model)
    return result


def picture(artist: Artist, things: list[Thing], marker_column: float | None, marker_row: float = 60) -> Image:
    plain = artist.picture(things)
    if marker_column is None:
        return plain
    return artist.with_marker(plain, 7, marker_warp(marker_row, marker_column, 15, 0.1, 0.5))


def test_points_and_disparities(artist: Artist, recogniser: Recogniser) -> None:
    left = picture(artist, [CUP], 200.3)
    right = picture(artist, [CUP.moved(0, -60.4)], 120.8)
    seen = recogniser.see(left, right, "cup")
    assert seen.object.array() == pytest.approx([150, 170, 60.4], abs=0.2)
    assert seen.hand.array() == pytest.approx([60, 200.3, 79.5], abs=0.1)
    assert 0.9 < seen.object_confidence <= 1
    assert 0.9 < seen.hand_confidence <= 1


def test_rows_may_differ_by_the_lens_distortion(artist: Artist, recogniser: Recogniser) -> None:
    seen = recogniser.see(picture(artist, [CUP], 200), picture(artist, [CUP.moved(3, -60)], 120, 62), "cup")
    assert seen.object.row == pytest.approx(150, abs=0.2)
    assert seen.hand.row == pytest.approx(60, abs=0.1)


@pytest.mark.parametrize(
    ("rows", "columns"), [(0, -20), (0, 20), (-28, 0), (28, 0)], ids=["left", "right", "top", "foot"]
)
def test_what_is_hidden_in_one_picture_has_its_size_from_the_other(
    artist: Artist, recogniser: Recogniser, rows: float, columns: float
) -> None:
    card = Thing(150 + rows, 170 + columns, (30 if columns else 12, 22 if rows else 10), ((90, 90, 92),), "rectangle")
    hidden, whole = artist.picture([CUP, card]), artist.picture([CUP.moved(0, -60)])
    alone = recogniser.model("cup").locate(hidden)[0]
    assert np.hypot(alone.row - 150, alone.column - 170) > 1.0
    for first, second, shift in ((hidden, whole, 0.0), (artist.picture([CUP.moved(0, 60)]), hidden, 60.0)):
        seen, confidence = recogniser.see_object(first, second, "cup")
        assert seen.array() == pytest.approx([150, 170 + shift, 60], abs=0.5)
        assert confidence < 0.97


def test_of_two_cups_the_pair_of_equal_rows_is_taken(artist: Artist, recogniser: Recogniser) -> None:
    left = picture(artist, [CUP], 200)
    right = picture(artist, [CUP.moved(45, 20), CUP.moved(0, -60)], 120)
    assert recogniser.see(left, right, "cup").object.disparity == pytest.approx(60, abs=0.2)


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (([], 200), ([CUP.moved(0, -60)], 120), "object 'cup' is not seen in the left picture.*put it into view"),
        (([CUP], 200), ([OTHER.moved(0, -60)], 120), "object 'cup' is not seen in the right picture"),
        (([CUP], 200), ([CUP.moved(0, -160)], 120), "object 'cup' .* right picture: it is cut by the picture's border"),
        (([CUP], 200), ([CUP.moved(25, -60)], 120), "object 'cup' is not seen: .* not the same thing"),
        (([CUP], 200), ([CUP.moved(0, 30)], 120), "object 'cup' is not seen: .* not the same thing"),
        (([CUP], None), ([CUP.moved(0, -60)], 120), "the hand is not seen in the left picture.*number 7"),
        (([CUP], 200), ([CUP.moved(0, -60)], None), "the hand is not seen in the right picture"),
        (([CUP], 120), ([CUP.moved(0, -60)], 200), "the hand is not seen: .* cannot be the same marker"),
    ],
    ids=["missing", "wrong object", "cut", "rows differ", "behind", "no hand left", "no hand right", "exchanged"],
)
def test_what_is_not_seen_is_named(artist: Artist, recogniser: Recogniser, left: View, right: View, words: str) -> None:
    with pytest.raises(NotSeen, match=words):
        recogniser.see(picture(artist, *left), picture(artist, *right), "cup")


def test_unknown_names_and_unequal_pictures_are_refused(artist: Artist, recogniser: Recogniser) -> None:
    plain = artist.picture()
    with pytest.raises(KeyError, match="known are cup"):
        recogniser.see(plain, plain, "jug")
    with pytest.raises(ValueError, match="differ in size"):
        recogniser.see(plain, plain[:100], "cup")
    assert recogniser.objects == ("cup",)


class Lab:
    """Robot and one cup, posed without physics, and the rig's pictures of them."""

    def __init__(self) -> None:
        pybullet = pytest.importorskip("pybullet")
        from handeye.simulation import gripper, objects, rig, scene
        from handeye.simulation.camera import Camera
        from handeye.simulation.profile import Profile

        self.pybullet, self.rig, self.profile = pybullet, rig, Profile.named("default")
        self.cup = objects.CUPS["blue cup"]
        self.open = np.full(2, gripper.FINGER_TRAVEL)
        self.exposures = 0
        # Table and floor fill most of a picture: they are drawn once and the rest over it, as the lab's own cameras do.
        self.stage = scene.build(pybullet.connect(pybullet.DIRECT), [self.cup])
        still = scene.build(pybullet.connect(pybullet.DIRECT))
        self.clients = (self.stage.client, still.client)
        self._remove(
            self.stage.client, self._bodies(self.stage.client) - {self.stage.robot, *self.stage.objects.values()}
        )
        self._remove(still.client, {still.robot})
        self.views = []
        for name in ("left", "right"):
            camera, pose = Camera(name, self.profile), rig.camera_from_world(name, *rig.rig().head.home)
            self.views.append((camera, pose, camera.draw(still.client, pose)))

    def _bodies(self, client: int) -> set[int]:
        count = self.pybullet.getNumBodies(physicsClientId=client)
        return {self.pybullet.getBodyUniqueId(index, physicsClientId=client) for index in range(count)}

    def _remove(self, client: int, bodies: set[int]) -> None:
        for body in bodies:
            self.pybullet.removeBody(body, physicsClientId=client)

    def close(self) -> None:
        for client in self.clients:
            self.pybullet.disconnect(client)

    def pose(self, joints: Floats, xy: tuple[float, float] | None) -> None:
        self.stage.set_joints(joints, self.open)
        position = (0.0, 0.0, -20.0) if xy is None else (*xy, self.cup.height / 2)
        self.pybullet.resetBasePositionAndOrientation(
            self.stage.objects[self.cup.name], position, (0, 0, 0, 1), physicsClientId=self.stage.client
        )

    def pair(self) -> tuple[Image, Image]:
        self.exposures += 1
        left, right = (
            camera.develop(camera.draw(self.stage.client, pose).over(backdrop), 0, self.exposures)
            for camera, pose, backdrop in self.views
        )
        return left, right

    def truth(self, point: Floats) -> Floats:
        """(row, column, disparity) in px of a world point."""
        head = self.rig.rig().head.home
        left, right = (self.rig.project(point, name, *head, self.profile) for name in ("left", "right"))
        return np.array([left[0], left[1], left[1] - right[1]])


@pytest.fixture
def lab() -> Iterator[Lab]:
    result = Lab()
    try:
        yield result
    finally:
        result.close()


def test_lab_pictures(lab: Lab) -> None:
    from handeye.simulation import grasping, gripper, kinematics

    park = grasping.PARK
    lab.pose(park, None)
    backgrounds = lab.pair()
    examples: list[Image] = []
    for xy in ((0.60, 0.0), (0.50, -0.10), (0.70, 0.10)):
        lab.pose(park, xy)
        examples += lab.pair()
    recogniser = Recogniser(gripper.MARKER_ID)
    recogniser.register("cup", ObjectModel.learn(backgrounds, examples))

    object_errors, hand_errors = [], []
    for xy in ((0.48, 0.12), (0.56, -0.05), (0.72, -0.12)):
        at = np.array(xy)
        for joints in (grasping.solve(grasping.approach_pose(at)), grasping.solve(grasping.grasp_pose(at))):
            lab.pose(joints, xy)
            left, right = lab.pair()
            seen = recogniser.see(left, right, "cup")
            marker = (kinematics.forward(joints) @ gripper.TOOL_FROM_MARKER)[:3, 3]
            hand_errors.append(seen.hand.array() - lab.truth(marker))
            object_errors.append(seen.object.array() - lab.truth(np.array([*xy, lab.cup.height / 2])))
    # A constant difference between silhouette's and cup's centre is harmless to a learner; scatter is not.
    assert np.abs(hand_errors).max() < 0.4
    assert np.std(hand_errors, axis=0).max() < 0.1
    assert np.std(object_errors, axis=0).max() < 0.4
    assert np.abs(np.mean(object_errors, axis=0)).max() < 1.0

    lab.pose(park, None)
    absent = lab.pair()
    with pytest.raises(NotSeen, match="object 'cup' is not seen in the left picture"):
        recogniser.see(*absent, "cup")
