"""Collecting, gazing and reaching on the toy world: whose cameras and arm nobody told the coordinator of."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.modules import css
from handeye.server.answering import NothingTaught
from handeye.server.gaze import GazeSettings
from handeye.server.results import CollectResult, GazeResult, JobView, ReachResult
from handeye.server.schemas.coordination import GridViewRequest, PosturesRequest, ReachRequest
from handeye.server.settings import ServerSettings
from tests.modules.test_grid import drawn
from tests.server.rest import done, ended, problem
from tests.server.toys import LATENCY, PARK

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from starlette.testclient import TestClient

    from handeye.modules.spaces import ImagePoint
    from handeye.server.job import Job
    from tests.server.conftest import Lab

MIDDLE = np.array([23.5, 31.5])  # of the toy's pictures
REGION: dict[str, Any] = {"lower": (0.5, -0.3, 0.2), "upper": (0.8, 0.0, 0.44)}
SYNERGIES = tuple(tuple(map(float, row)) for row in np.eye(6)[:3])


def view(job: Job) -> JobView:
    assert job.wait(120.0)
    return job.view()


def succeeded(job: Job) -> JobView:
    told = view(job)
    assert told.error is None, told.error
    return told


def show_cup(lab: Lab) -> None:
    lab.coordinator.show_object("blue cup", "backgrounds", 0.0)
    lab.coordinator.show_object("blue cup", "examples", 0.0)


def fixate(lab: Lab, count: int) -> None:
    """From so many poses of the head, each with the cup elsewhere."""
    random = np.random.default_rng(3)
    show_cup(lab)
    for _ in range(count):
        lab.world.cup = np.array([*random.uniform((100.0, 200.0), (300.0, 440.0)), random.uniform(120.0, 180.0)])
        lab.world.head = (0.0, float(random.uniform(-0.15, 0.15)))
        succeeded(lab.coordinator.coordination.collect_fixation("blue cup", "all"))


def teach_css(lab: Lab) -> None:
    """As a camera that measures everything in thousands of px."""
    random = np.random.default_rng(4)
    seen = np.column_stack(
        [random.uniform(-400, 700, 3000), random.uniform(-400, 800, 3000), random.uniform(50, 250, 3000)]
    )
    lab.coordinator.modules.create(css.DECLARATION)
    lab.coordinator.modules.add("CSS", seen, seen / 1000.0, [None] * len(seen))


def collect(lab: Lab, *modules: str, postures: int = 60, **options: Any) -> CollectResult:
    request = {"modules": modules, "postures": postures, "synergies": SYNERGIES, **REGION, **options}
    told = succeeded(lab.coordinator.coordination.collect_postures(PosturesRequest.model_validate(request)))
    assert isinstance(told.result, CollectResult)
    return told.result


def able(lab: Lab) -> None:
    """Everything that reaching needs."""
    fixate(lab, 8)
    teach_css(lab)
    lab.world.head = (-0.35, -0.3)
    collect(lab, "AJS", "CAS", postures=120)
    lab.world.head = (-0.35, -0.3)


def reach(lab: Lab, target: NDArray[np.float64], *, one_look: bool = False) -> JobView:
    point = tuple((target + lab.world.shift).tolist())
    return view(lab.coordinator.coordination.reach(ReachRequest(point=point, one_look=one_look)))


def looks(job: JobView) -> ReachResult:
    assert isinstance(job.result, ReachResult)
    return job.result


class TestFixating:
    def test_every_look_is_a_sample_of_the_way_to_the_middle(self, lab: Lab) -> None:
        show_cup(lab)
        lab.world.cup = np.array([200.0, 300.0, 150.0])
        told = succeeded(lab.coordinator.coordination.collect_fixation("blue cup", "all"))
        assert isinstance(told.result, CollectResult)
        samples = lab.coordinator.modules.samples("SCS", -1, 100)[0]
        assert told.result.added == {"SCS": len(samples.numbers)}
        assert len(samples.numbers) >= 4
        for given, wanted in zip(samples.inputs, samples.outputs, strict=True):
            # Where the head was is not in the sample; the picture tells.
            row, column, _, tilt = given
            pan = np.arctan((column - 300.0) / 600.0)
            middle = 200.0 + 600.0 * np.tan(tilt + wanted[1]), 300.0 + 600.0 * np.tan(pan + wanted[0])
            assert middle == pytest.approx(MIDDLE, abs=1.0)
            assert row == pytest.approx(200.0 + 600.0 * np.tan(tilt), abs=0.1)

    @pytest.mark.parametrize(("keep", "offset"), [("first", 325.0), ("last", 0.0)])
    def test_one_look_is_enough_if_asked_for(self, lab: Lab, keep: Any, offset: float) -> None:
        show_cup(lab)
        lab.world.cup = np.array([200.0, 300.0, 150.0])
        succeeded(lab.coordinator.coordination.collect_fixation("blue cup", keep))
        samples = lab.coordinator.modules.samples("SCS", -1, 100)[0]
        assert len(samples.numbers) == 1
        assert np.linalg.norm(samples.inputs[0, :2] - MIDDLE) == pytest.approx(offset, abs=5.0)

    def test_at_the_end_of_the_heads_range_it_probes_the_other_way(self, lab: Lab) -> None:
        show_cup(lab)
        lab.world.head = (0.98, 0.0)  # it turns to 1.0
        lab.world.cup = np.array([200.0, MIDDLE[1] - 600.0 * np.tan(0.9), 150.0])
        succeeded(lab.coordinator.coordination.collect_fixation("blue cup", "all"))
        assert lab.world.head[0] == pytest.approx(0.9, abs=0.01)

    def test_what_is_not_seen_teaches_nothing(self, lab: Lab) -> None:
        show_cup(lab)
        lab.world.hidden.add("object")
        told = view(lab.coordinator.coordination.collect_fixation("blue cup", "all"))
        assert told.error is not None
        assert told.error.code == "not_seen"
        assert lab.coordinator.modules.live("SCS").samples == 0

    def test_what_moves_meanwhile_teaches_nothing(self, lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
        show_cup(lab)
        lab.world.cup = np.array([200.0, 300.0, 150.0])
        find, looks = lab.sight.see_object, itertools.count()

        def see_object(*seen: Any) -> tuple[ImagePoint, float]:
            if next(looks) == 1:
                lab.world.cup = lab.world.cup + np.array([0.0, 20.0, 0.0])
            return find(*seen)

        monkeypatch.setattr(lab.sight, "see_object", see_object)
        told = view(lab.coordinator.coordination.collect_fixation("blue cup", "all"))
        assert told.error is not None
        assert told.error.code == "not_fixated"
        assert "must rest" in told.error.message
        assert isinstance(told.result, CollectResult)
        assert told.result.rejected == {"moving": 1}
        assert lab.coordinator.modules.live("SCS").samples == 0

    def test_a_view_that_head_turns_do_not_change_is_given_up(self, lab: Lab) -> None:
        show_cup(lab)
        lab.cameras.gate = None
        lab.coordinator.control.head.move = lambda *_args, **_kwargs: lab.coordinator.control.head.state()  # type: ignore[method-assign]
        told = view(lab.coordinator.coordination.collect_fixation("blue cup", "all"))
        assert told.error is not None
        assert told.error.code == "not_fixated"


class TestGaze:
    def test_centres_from_anywhere(self, lab: Lab) -> None:
        fixate(lab, 10)
        lab.world.cup = np.array([310.0, 290.0, 140.0])
        lab.world.head = (0.05, 0.1)
        told = succeeded(lab.coordinator.coordination.gaze("blue cup"))
        assert isinstance(told.result, GazeResult)
        assert np.linalg.norm((lab.world.cup + lab.world.shift)[:2] - MIDDLE) < 1.5
        assert told.result.middle == tuple(MIDDLE)
        assert told.result.looks[0].offset > 300.0
        assert told.result.looks[-1].offset <= 1.0
        assert told.result.looks[-1].turn == ()

    def test_needs_to_be_taught(self, lab: Lab) -> None:
        told = view(lab.coordinator.coordination.gaze(None))
        assert told.error is not None
        assert told.error.code == "not_taught"
        assert "handeye collect SCS" in told.error.message

    def test_does_not_turn_where_it_was_not_taught(self, lab: Lab) -> None:
        fixate(lab, 4)
        lab.world.cup = np.array([200.0, 300.0, 150.0])
        lab.world.head = (0.0, 0.49)
        lab.coordinator.coordination.settings = ServerSettings(gazing=GazeSettings(least_support=0.9))
        told = view(lab.coordinator.coordination.gaze("blue cup"))
        assert told.error is not None
        assert told.error.code == "outside_taught_region"
        assert lab.world.head == (0.0, 0.49)


class TestPursuit:
    def test_follows_what_moves_for_as_long_as_asked(self, http: TestClient, lab: Lab) -> None:
        fixate(lab, 10)
        lab.world.head = (0.0, 0.1)
        begun = lab.world.time
        seen = lab.sight.see_object

        def moving(*shown: Any) -> Any:
            lab.world.cup = np.array([150.0, 250.0 + 20.0 * (lab.world.time - LATENCY - begun), 150.0])
            return seen(*shown)

        lab.sight.see_object = moving  # type: ignore[method-assign]
        job = ended(http, http.post("/v1/pursuits", json={"object": "blue cup", "duration": 3.0}))
        assert (job["kind"], job["subject"], job["state"]) == ("pursuit", "blue cup", "succeeded")
        looks = job["result"]["looks"]
        assert looks[-1]["world_time"] - looks[0]["world_time"] == pytest.approx(3.0, abs=0.2)
        assert looks[0]["offset"] > 100.0
        # The toy's head jumps and then stands: in a tenth of a second the cup goes on by two px.
        assert max(look["offset"] for look in looks[10:]) < 6.0
        assert all(look["support"] > 0.1 and len(look["rate"]) == 2 for look in looks)
        assert not lab.robot.leased

    def test_ends_when_it_is_lost(self, http: TestClient, lab: Lab) -> None:
        fixate(lab, 10)
        step, looks = lab.cameras.grab_stereo, iter(range(1000))

        def hiding(*arguments: Any) -> Any:
            if next(looks) == 5:
                lab.world.hidden.add("object")
            return step(*arguments)

        lab.cameras.grab_stereo = hiding  # type: ignore[assignment, method-assign]
        job = ended(http, http.post("/v1/pursuits", json={"object": "blue cup", "duration": 60.0}))
        assert job["error"]["code"] == "object_lost"
        assert job["result"]["looks"][-1]["point"] is None

    def test_can_be_cancelled(self, lab: Lab) -> None:
        fixate(lab, 10)
        job = lab.coordinator.coordination.pursue("blue cup", 120.0)
        job.events(3, 30.0)
        job.cancel()
        assert view(job).state == "cancelled"
        assert not lab.robot.leased

    def test_needs_an_end_an_object_and_scs(self, http: TestClient, lab: Lab) -> None:
        for body in ({"object": "blue cup"}, {"duration": 3.0}, {"object": "blue cup", "duration": 0.0}):
            problem(http.post("/v1/pursuits", json=body), 422, "invalid_argument")
        problem(http.post("/v1/pursuits", json={"object": "red cup", "duration": 3.0}), 404, "not_found")
        show_cup(lab)
        told = problem(http.post("/v1/pursuits", json={"object": "blue cup", "duration": 3.0}), 409, "not_taught")
        assert "handeye collect SCS" in told


class TestBabbling:
    def test_ajs_learns_what_the_arm_is_like(self, lab: Lab) -> None:
        collected = collect(lab, "AJS", postures=80)
        samples = lab.coordinator.modules.samples("AJS", -1, 10_000)[0]
        assert collected.added["AJS"] == len(samples.numbers) > 200
        # The toy's point: 0.3 m for each rad of the first three joints.
        goals = [0.5, 0.0, 0.2] + 0.3 * (samples.inputs[:, 3:6] + samples.outputs[:, :3])
        np.testing.assert_allclose(goals, samples.inputs[:, :3], atol=1e-9)
        inside = (goals > np.array(REGION["lower"]) - 0.05).all() and (goals < np.array(REGION["upper"]) + 0.05).all()
        assert inside
        spread = np.ptp(goals, axis=0) / (np.array(REGION["upper"]) - REGION["lower"])
        assert (spread > 0.7).all()

    def test_goes_on_where_it_ended(self, lab: Lab) -> None:
        collect(lab, "AJS", postures=10)
        before = lab.coordinator.modules.live("AJS").samples
        lab.world.joints = PARK.copy()  # as a world that was made anew begins
        again = collect(lab, "AJS", postures=25)
        assert lab.coordinator.modules.live("AJS").samples == before + again.added["AJS"]
        inputs = lab.coordinator.modules.samples("AJS", -1, 1000)[0].inputs
        assert len(np.unique(inputs[:, :3], axis=0)) == 9 + 14  # none was visited twice
        assert "posture-25" in lab.coordinator.modules.demonstrations("AJS")
        assert collect(lab, "AJS", postures=25).added == {"AJS": 0}

    def test_rejects_what_it_does_not_see(self, lab: Lab) -> None:
        fixate(lab, 8)
        teach_css(lab)
        lab.world.hidden.add("hand")
        before = lab.world.head
        request = {"modules": ("CAS",), "postures": 5, "synergies": SYNERGIES, **REGION}
        told = view(lab.coordinator.coordination.collect_postures(PosturesRequest.model_validate(request)))
        assert told.error is not None
        assert told.error.code == "no_postures"
        assert isinstance(told.result, CollectResult)
        assert told.result.added == {"CAS": 0}
        assert told.result.rejected["hand not found"] > 10
        # It always searches around there: from where the last search ended it would drift away.
        assert np.abs(np.subtract(lab.world.head, before)).max() < 0.3

    def test_ijs_learns_pictures_from_one_pose_of_the_head(self, lab: Lab) -> None:
        lab.world.head = (-0.35, -0.3)
        collect(lab, "IJS", postures=30)
        samples = lab.coordinator.modules.samples("IJS", -1, 10_000)[0]
        # The toy's picture is linear in its first three joints.
        moved = samples.outputs[:, :3] * [100.0, 120.0, 60.0]
        np.testing.assert_allclose(moved, samples.inputs[:, 1:4], atol=0.2)
        assert lab.world.head == (-0.35, -0.3)

    def test_cas_needs_css_and_scs(self, http: TestClient) -> None:
        body = {"modules": ["CAS"], "synergies": SYNERGIES, **REGION}
        assert "handeye collect CSS" in problem(http.post("/v1/collect/postures", json=body), 409, "not_taught")

    def test_synergies_are_the_robots(self, http: TestClient) -> None:
        body = {"modules": ["AJS"], "synergies": [[1.0, 0.0]]}
        assert "6 numbers" in problem(http.post("/v1/collect/postures", json=body), 422, "invalid_argument")

    def test_a_module_of_another_shape_is_not_touched(self, http: TestClient) -> None:
        other = {"name": "AJS", "inputs": [{"name": "x", "unit": ""}], "outputs": [{"name": "y", "unit": ""}]}
        done(http.post("/v1/modules", json=other), 201)
        problem(http.post("/v1/collect/postures", json={"modules": ["AJS"]}), 409, "conflict")

    def test_can_be_cancelled(self, lab: Lab) -> None:
        job = lab.coordinator.coordination.collect_postures(
            PosturesRequest.model_validate({"modules": ("AJS",), "postures": 10_000, "synergies": SYNERGIES, **REGION})
        )
        job.events(5, 30.0)
        job.cancel()
        told = view(job)
        assert told.state == "cancelled"
        assert not lab.robot.leased


class TestReaching:
    def test_converges_from_any_pose_of_the_head_with_an_arm_that_is_not_exact(self, lab: Lab) -> None:
        able(lab)
        lab.world.reads = 0.9
        for head, joints in (((-0.35, -0.3), (0.6, -0.6, 0.5)), ((-0.2, -0.1), (0.2, -0.3, 0.7))):
            lab.world.head = head
            target = np.array([240.0, 320.0, 150.0]) + np.array([100.0, 120.0, 60.0]) * joints
            told = reach(lab, target)
            assert told.state == "succeeded", told.error
            assert np.abs(lab.world.hand - target).max() < 0.6
            assert lab.world.head == head
            result = looks(told)
            assert 2 <= len(result.looks) <= 6
            assert [each.module for each in result.looks[0].answers] == ["CSS", "CAS", "CSS", "CAS", "AJS"]
            assert all(each.neighbours for each in result.looks[0].answers)
            assert result.looks[-1].away < result.looks[0].away

    def test_one_look_moves_once_and_does_not_check(self, lab: Lab) -> None:
        able(lab)
        lab.world.reads = 0.8
        before = lab.world.hand
        target = np.array([300.0, 240.0, 180.0])
        told = reach(lab, target, one_look=True)
        assert told.state == "succeeded"
        assert len(looks(told).looks) == 1
        left = np.linalg.norm(lab.world.hand - target) / np.linalg.norm(before - target)
        assert left == pytest.approx(0.2, abs=0.05)

    def test_gives_up_with_a_reason(self, lab: Lab) -> None:
        able(lab)
        lab.world.reads = 0.0
        told = reach(lab, np.array([300.0, 240.0, 180.0]))
        assert told.error is not None
        assert told.error.code == "not_reached"
        assert "6 looks" in told.error.message

    def test_holds_outside_of_what_was_taught(self, lab: Lab) -> None:
        able(lab)
        before = lab.world.joints.copy()
        told = reach(lab, np.array([900.0, -700.0, 20.0]))
        assert told.error is not None
        assert told.error.code == "outside_taught_region"
        assert looks(told).looks[-1].moved == ()
        np.testing.assert_array_equal(lab.world.joints, before)

    def test_a_hidden_hand_is_told_with_a_picture(self, lab: Lab) -> None:
        able(lab)
        lab.world.hidden.add("hand")
        job = lab.coordinator.coordination.reach(ReachRequest(point=(240.0, 320.0, 150.0)))
        assert view(job).state == "failed"
        assert [event.data["message"] for event in job.events(0, 1.0) if event.kind == "not_seen"]

    def test_goes_to_an_object_and_needs_one_target(self, http: TestClient, lab: Lab) -> None:
        able(lab)
        show_cup(lab)
        lab.world.cup = np.array([290.0, 250.0, 175.0])
        job = ended(http, http.post("/v1/reaches", json={"object": "blue cup"}))
        assert (job["kind"], job["subject"], job["state"]) == ("reach", "blue cup", "succeeded")
        assert np.abs(lab.world.hand - lab.world.cup).max() < 0.6
        for look in job["result"]["looks"]:
            assert http.get(look["picture"]).headers["content-type"] == "image/jpeg"
        for body in ({}, {"object": "blue cup", "point": [1.0, 2.0, 3.0]}, {"point": [1.0, 2.0]}):
            problem(http.post("/v1/reaches", json=body), 422, "invalid_argument")
        problem(http.post("/v1/reaches", json={"object": "red cup"}), 404, "not_found")

    def test_an_object_that_is_moved_meanwhile_is_followed(self, lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
        able(lab)
        lab.world.cup = np.array([290.0, 250.0, 175.0])
        moved = np.array([270.0, 280.0, 165.0])
        find = lab.sight.see_object

        def see_object(*seen: Any) -> tuple[ImagePoint, float]:
            found = find(*seen)
            lab.world.cup = moved
            return found

        monkeypatch.setattr(lab.sight, "see_object", see_object)
        told = succeeded(lab.coordinator.coordination.reach(ReachRequest(object="blue cup")))
        assert np.abs(lab.world.hand - moved).max() < 0.6
        assert looks(told).looks[0].target != looks(told).looks[-1].target

    def test_an_object_that_is_hidden_meanwhile_is_where_it_was(
        self, lab: Lab, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        able(lab)
        lab.world.cup = np.array([290.0, 250.0, 175.0])
        find = lab.sight.see_object

        def see_object(*seen: Any) -> tuple[ImagePoint, float]:
            found = find(*seen)
            lab.world.hidden.add("object")
            return found

        monkeypatch.setattr(lab.sight, "see_object", see_object)
        succeeded(lab.coordinator.coordination.reach(ReachRequest(object="blue cup")))
        assert np.abs(lab.world.hand - lab.world.cup).max() < 0.6

    def test_the_head_turns_to_the_object_before_if_asked_to(self, http: TestClient, lab: Lab) -> None:
        able(lab)
        lab.world.head = (-0.2, -0.1)
        lab.world.cup = np.array([290.0, 250.0, 175.0])
        job = ended(http, http.post("/v1/reaches", json={"object": "blue cup", "gaze": True}))
        assert job["state"] == "succeeded", job["error"]
        assert np.abs(lab.world.hand - lab.world.cup).max() < 2.0  # CAS saw few hands from there
        seen = np.array(job["result"]["looks"][0]["target"])[:2]
        assert np.abs(seen - MIDDLE).max() < 30.0  # of 200 px; it was fixated eight times only
        assert np.abs((lab.world.cup + lab.world.shift)[:2] - seen).max() < 1.0
        problem(http.post("/v1/reaches", json={"point": [1.0, 2.0, 3.0], "gaze": True}), 422, "invalid_argument")

    def test_the_head_turns_by_what_it_was_taught_only(self, lab: Lab) -> None:
        show_cup(lab)
        with pytest.raises(NothingTaught, match="SCS"):
            lab.coordinator.coordination.reach(ReachRequest(object="blue cup", gaze=True))


class TestGridViews:
    def test_css_learns_where_the_intersections_are(
        self, http: TestClient, lab: Lab, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        random = np.random.default_rng(6)
        for number in range(1, 4):
            left, corners = drawn(0.1, (240.0 + 5 * number, 360.0))
            right, _ = drawn(0.1, (240.0 + 5 * number, 300.0 - 20 * number))
            grab = lab.cameras.grab_stereo
            pair = grab(0.0, 1.0)
            shown = replace(pair, left=replace(pair.left, image=left), right=replace(pair.right, image=right))
            monkeypatch.setattr(lab.cameras, "grab_stereo", lambda *_args, shown=shown: shown)
            points = random.normal(size=(*corners.shape[:2], 3)).tolist()
            body = {"points": points, "every": 2}
            key = {"Idempotency-Key": f"view-{number}"}
            told = done(http.post("/v1/collect/grid-views", json=body, headers=key), 201)
            assert told == {"added": {"CSS": 15}, "rejected": {}}
            assert done(http.post("/v1/collect/grid-views", json=body, headers=key), 201) == told
            monkeypatch.setattr(lab.cameras, "grab_stereo", grab)
            samples = lab.coordinator.modules.samples("CSS", 15 * (number - 1) - 1, 100)[0]
            assert samples.demonstrations == (f"view-{number}",) * 15
            np.testing.assert_allclose(samples.inputs[:, :2], corners[::2, ::2].reshape(-1, 2), atol=0.5)
            np.testing.assert_allclose(samples.inputs[:, 2], 60.0 + 20 * number, atol=0.5)
            np.testing.assert_array_equal(samples.outputs, np.array(points)[::2, ::2].reshape(-1, 3))


class TestLooking:
    def test_tells_where_something_is_and_from_where(self, http: TestClient, lab: Lab) -> None:
        show_cup(lab)
        lab.world.head = (0.1, -0.2)
        told = done(http.post("/v1/looks", json={"object": "blue cup"}))
        np.testing.assert_allclose(told["point"], lab.world.cup + lab.world.shift, atol=0.1)
        assert (told["pan"], told["tilt"]) == (0.1, -0.2)
        assert told["world_time"] == pytest.approx(lab.world.time - LATENCY)
        lab.world.hidden.add("hand")
        problem(http.post("/v1/looks", json={}), 422, "not_seen")

    def test_a_grid_that_is_not_there_is_not_seen(self, http: TestClient, lab: Lab) -> None:
        points = np.zeros((3, 4, 3)).tolist()
        assert "grid" in problem(http.post("/v1/collect/grid-views", json={"points": points}), 422, "not_seen")
        ragged = [points[0], points[1], points[2][:3]]
        problem(http.post("/v1/collect/grid-views", json={"points": ragged}), 422, "invalid_argument")
        assert GridViewRequest.model_validate({"points": points}).not_older_than == 0.0
