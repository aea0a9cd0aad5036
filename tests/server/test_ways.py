"""Tasks with several objects, and ways that nobody looks at: shown, trained, done, on the toy world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.robot_bridge.driver import RobotState, Watch, unwatched
from handeye.server.pairs import NotTeachable, waypoint_codes
from handeye.server.problem import Conflict, NotFound
from handeye.server.results import JobState, JobView, RunResult
from handeye.server.store.demonstrations import _observation
from handeye.server.store.rows import dumps
from handeye.server.training import TrainRequest
from tests.server.rest import done, problem
from tests.server.toys import JOINTS, LATENCY, PARK

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab

CUP, JAR = "blue cup", "green jar"
TURN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.5])
"""What the way does: the last joint turns, and turns back."""
SECONDS = (3.0, 0.5, 1.0)


def at(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """The joints with the hand at a place (row, column, disparity)."""
    joints = np.zeros(JOINTS)
    joints[:3] = (place - [240.0, 320.0, 150.0]) / [100.0, 120.0, 60.0]
    return joints


def show(lab: Lab, jar: tuple[float, float], *, seconds: tuple[float, ...] = SECONDS, towards: str = JAR) -> str:
    """One demonstration: to the cup, close; to the jar, there turn, wait and turn back."""
    coordinator, world = lab.coordinator, lab.world
    random = np.random.default_rng(int(jar[0] * 1000 + jar[1]))
    world.others[JAR] = np.array([*jar, 140.0])
    shown = coordinator.demonstrations.begin("pour", CUP).id
    for subtask, goal, named in (("grasp", at(world.cup), None), ("pour", at(world.others[JAR]), towards)):
        for share in (0.0, 0.5, 0.8, 0.95, 1.0):
            world.joints = PARK + share * (goal - PARK) + (random.normal(0.0, 0.02, JOINTS) if 0 < share < 1 else 0.0)
            world.time += LATENCY
            world.still_since = world.time - LATENCY
            coordinator.observe(shown, subtask, named, goal=share == 1.0, key=share == 0.0)
        if subtask == "grasp":
            coordinator.demonstrations.act(shown, subtask, "close_gripper")
    end = world.joints
    begun = coordinator.demonstrations.get(shown).observations[-1].world_time
    for passed, joints in zip(seconds, (end + TURN, end + TURN, end), strict=False):
        begun += passed
        if (joints != world.joints).any():
            world.still_since = begun
        world.joints, world.time = joints, begun
        coordinator.pass_by(shown, "pour")
    return shown


@pytest.fixture
def pouring(lab: Lab) -> Lab:
    for name in (CUP, JAR):
        lab.coordinator.show_object(name, "backgrounds", 0.0)
        lab.coordinator.show_object(name, "examples", 0.0)
    lab.world.cup = np.array([240.0, 300.0, 150.0])
    return lab


def taught(lab: Lab) -> None:
    for number, jar in enumerate((r, c) for r in (200.0, 220.0, 240.0) for c in (360.0, 390.0, 420.0)):
        slower = tuple(each + 0.01 * (number - 4) for each in SECONDS)
        lab.coordinator.demonstrations.finish(show(lab, jar, seconds=slower))
    lab.train("pour")
    lab.world.joints = PARK.copy()
    lab.world.others[JAR] = np.array([212.0, 378.0, 140.0])
    lab.robot.commands.clear()


def run(lab: Lab, *, one_look: bool = False) -> JobView:
    job = lab.coordinator.run("pour", CUP, one_look=one_look)
    assert job.wait(30.0)
    return job.view()


def test_a_demonstration_has_the_objects_and_ways_that_were_shown(pouring: Lab) -> None:
    shown = pouring.coordinator.demonstrations.get(show(pouring, (220.0, 390.0)))
    grasp, pour = shown.subtasks
    assert (grasp.object, grasp.way, grasp.action) == (None, (), "close_gripper")
    assert (pour.object, pour.action) == (JAR, None)
    assert pour.way == pytest.approx(SECONDS)  # the second one is a wait: the arm does not move
    look = shown.observations[5]
    assert look.object == JAR
    assert look.found is not None
    assert look.found.object.column == 390.0
    first = shown.way("pour")[0]
    assert (first.found, first.goal, first.key, first.object) == (None, False, False, JAR)
    np.testing.assert_allclose(first.joints, shown.observations[9].joints + TURN)


def test_it_is_done_towards_both_objects_and_along_the_way_in_its_time(pouring: Lab) -> None:
    taught(pouring)
    job = run(pouring)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    assert isinstance(job.result, RunResult)
    grasp, pour = job.result.subtasks
    assert (grasp.object, pour.object) == (CUP, JAR)
    assert {look.object for look in grasp.looks} == {tuple(pouring.world.cup)}
    assert {look.object for look in pour.looks} == {(212.0, 378.0, 140.0)}
    # At the jar, whose place was never shown, the last joint has turned and turned back.
    np.testing.assert_allclose(pouring.world.joints, at(pouring.world.others[JAR]), atol=0.01)
    assert [round(way.moved[5], 1) for way in pour.way] == [-1.5, 0.0, 1.5]
    assert [way.seconds for way in pour.way] == pytest.approx(SECONDS)  # the median of what was shown
    assert all(0.0 < way.support <= 1.0 and way.neighbours for way in pour.way)
    # A motion of the toy takes 1 s: for the rest of what was shown it waits.
    assert pour.ended is not None
    assert pour.ended - pour.looks[-1].world_time == pytest.approx(sum(SECONDS) + 0.5, abs=0.2)
    assert set(pouring.robot.commands) == {"adjust_joints", "close_gripper", "advance"}
    turned, waited, _back = pouring.robot.paces[-3:]
    assert turned == pytest.approx(0.5)  # never faster than its own pace
    assert waited < 0.1


def test_a_way_is_slowed_down_to_the_time_that_was_shown(pouring: Lab) -> None:
    for jar in ((200.0, 360.0), (240.0, 420.0), (220.0, 390.0)):
        pouring.coordinator.demonstrations.finish(show(pouring, jar, seconds=(15.0, 0.5, 10.0)))
    pouring.train("pour")
    pouring.world.joints = PARK.copy()
    assert run(pouring).state is JobState.SUCCEEDED
    turned, _waited, back = pouring.robot.paces[-3:]
    assert turned == pytest.approx(1.875 * 1.5 / 15.0, rel=0.05)
    assert back == pytest.approx(1.875 * 1.5 / 10.0, rel=0.05)


def test_a_long_wait_is_waited_in_pieces_that_a_bridge_takes(pouring: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    for jar in ((200.0, 360.0), (240.0, 420.0), (220.0, 390.0)):
        pouring.coordinator.demonstrations.finish(show(pouring, jar, seconds=(3.0, 150.0, 1.0)))
    pouring.train("pour")
    pouring.world.joints = PARK.copy()
    advance, waited = pouring.robot.advance, []

    def advancing(duration: float, watch: Watch = unwatched) -> RobotState:
        waited.append(duration)
        return advance(duration, watch)

    monkeypatch.setattr(pouring.robot, "advance", advancing)
    assert run(pouring).state is JobState.SUCCEEDED
    assert max(waited) == 60.0
    assert sum(waited) > 145.0


def test_with_one_look_the_way_follows_from_it(pouring: Lab) -> None:
    taught(pouring)
    job = run(pouring, one_look=True)
    assert isinstance(job.result, RunResult)
    assert [(len(each.looks), len(each.way)) for each in job.result.subtasks] == [(1, 0), (1, 3)]


def failed(lab: Lab, code: str) -> RunResult:
    job = run(lab)
    assert job.error is not None
    assert job.error.code == code
    assert lab.robot.commands[-1] == "stop"
    assert isinstance(job.result, RunResult)
    return job.result


def test_a_way_that_is_refused_is_not_begun(pouring: Lab) -> None:
    taught(pouring)
    settings = pouring.coordinator.settings
    acting = settings.acting.model_copy(update={"largest_move": 1.2})
    pouring.coordinator.settings = settings.model_copy(update={"acting": acting})
    result = failed(pouring, "out_of_limits")
    assert result.subtasks[-1].way == ()
    assert pouring.world.joints[5] == pytest.approx(0.0, abs=0.05)


def test_where_the_hand_is_not_aligned_no_way_begins(pouring: Lab) -> None:
    taught(pouring)
    settings = pouring.coordinator.settings
    acting = settings.acting.model_copy(update={"max_looks": 2, "tolerance": 0.05, "last_tolerance": 1e-6})
    pouring.coordinator.settings = settings.model_copy(
        update={"acting": acting.model_copy(update={"acceptable": 1e-6})}
    )
    pouring.world.reads = 0.9
    result = failed(pouring, "not_aligned")
    assert result.subtasks[-1].name == "pour"
    assert result.subtasks[-1].way == ()


def test_the_last_subtask_is_aligned_as_the_others_when_something_follows_its_goal(pouring: Lab) -> None:
    taught(pouring)
    settings = pouring.coordinator.settings
    acting = settings.acting.model_copy(update={"last_tolerance": 1.0})
    pouring.coordinator.settings = settings.model_copy(update={"acting": acting})
    assert run(pouring).state is JobState.SUCCEEDED
    np.testing.assert_allclose(pouring.world.joints, at(pouring.world.others[JAR]), atol=0.01)


def test_the_other_object_must_be_seen_and_known(pouring: Lab) -> None:
    taught(pouring)
    pouring.coordinator.objects.delete(JAR)
    with pytest.raises(NotFound, match=JAR):
        run(pouring)


def test_demonstrations_that_disagree_about_objects_or_ways_do_not_make_a_task(pouring: Lab) -> None:
    first, shorter, elsewhere = (
        show(pouring, (220.0, 390.0)),
        show(pouring, (230.0, 390.0), seconds=SECONDS[:2]),
        show(pouring, (240.0, 390.0), towards=CUP),
    )
    demonstrations = pouring.coordinator.demonstrations
    for other, why in ((shorter, "2 way-points"), (elsewhere, "pour along 3 way-points")):
        with pytest.raises(NotTeachable, match=why):
            pouring.coordinator.tasks.train(
                "pour", [demonstrations.finish(first), demonstrations.finish(other)], TrainRequest()
            )
        first = show(pouring, (220.0, 390.0))


def test_each_way_point_has_an_action_code_of_its_own(pouring: Lab) -> None:
    taught(pouring)
    task = pouring.coordinator.tasks.get("pour")
    assert waypoint_codes(task.subtasks) == {"grasp": range(2, 2), "pour": range(2, 5)}
    found = pouring.coordinator.tasks.module(task).statistics()
    assert sorted(each.category for each in found) == [(0.0,), (1.0,), (2.0,), (3.0,), (4.0,)]
    assert {each.samples for each in found} == {45}


def test_a_subtask_is_towards_one_object_and_its_way_comes_after_its_goal(pouring: Lab) -> None:
    coordinator = pouring.coordinator
    shown = coordinator.demonstrations.begin("pour", CUP).id
    with pytest.raises(Conflict, match="no goal yet"):
        coordinator.pass_by(shown, "pour")
    with pytest.raises(NotFound, match="red jar"):
        coordinator.observe(shown, "pour", "red jar", goal=True, key=True)
    coordinator.observe(shown, "pour", JAR, goal=True, key=True)
    with pytest.raises(Conflict, match=f"towards '{JAR}'.*'{CUP}'"):
        coordinator.observe(shown, "pour", goal=False, key=False)
    coordinator.pass_by(shown, "pour")
    with pytest.raises(Conflict, match="on its way already"):
        coordinator.observe(shown, "pour", JAR, goal=False, key=False)


def test_objects_and_ways_over_rest(pouring: Lab, http: TestClient) -> None:
    shown = done(http.post("/v1/demonstrations", json={"task": "pour", "object": CUP}), 201)["id"]
    here = f"/v1/demonstrations/{shown}"
    assert "no goal yet" in problem(http.post(f"{here}/waypoints", json={"subtask": "tip"}), 409, "conflict")
    pouring.world.others[JAR] = np.array([200.0, 400.0, 140.0])
    pouring.world.time += 1.0
    look = done(http.post(f"{here}/observations", json={"subtask": "tip", "object": JAR, "goal": True}), 201)
    assert (look["towards"], look["object"]) == (JAR, [200.0, 400.0, 140.0])
    pouring.world.time += 2.0
    passed = done(http.post(f"{here}/waypoints", json={"subtask": "tip"}), 201)
    assert (passed["object"], passed["hand"], passed["towards"]) == (None, None, JAR)
    assert passed["seconds"] == pytest.approx(2.0 + LATENCY)
    listed = done(http.get(f"{here}/observations"))["observations"]
    assert listed == [look, passed]
    info = done(http.post(f"{here}/finish"))
    (subtask,) = info["subtasks"]
    assert (subtask["object"], subtask["way"]) == (JAR, [passed["seconds"]])


def test_what_earlier_versions_have_written_down_is_read(pouring: Lab) -> None:
    """They had neither objects of subtasks nor ways."""
    content = {
        "subtask": "grasp",
        "world_time": 1.0,
        "object": [1.0, 2.0, 3.0, 0.9],
        "hand": [4.0, 5.0, 6.0, 0.8],
        "joints": [0.0] * 6,
        "goal": True,
        "key": False,
    }
    found = _observation({"number": 0, "content": dumps(content)}, CUP)
    assert (found.object, found.seconds) == (CUP, 0.0)
    assert found.found is not None
