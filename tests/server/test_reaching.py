"""Reaching on the toy world, whose cameras and arm nobody told the coordinator of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.server.answering import NothingTaught
from handeye.server.results import JobView, ReachResult
from handeye.server.schemas.coordination import ReachRequest
from tests.server.coordinating import (
    MIDDLE,
    able,
    show_cup,
    succeeded,
    view,
)
from tests.server.rest import ended, problem

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from starlette.testclient import TestClient

    from handeye.modules.spaces import ImagePoint
    from tests.server.conftest import Lab


def reach(lab: Lab, target: NDArray[np.float64], *, one_look: bool = False) -> JobView:
    point = tuple((target + lab.world.shift).tolist())
    return view(lab.coordinator.coordination.reach(ReachRequest(point=point, one_look=one_look)))


def looks(job: JobView) -> ReachResult:
    assert isinstance(job.result, ReachResult)
    return job.result


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
