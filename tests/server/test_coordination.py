"""Collecting, gazing and pursuing on the toy world: whose cameras and arm nobody told the coordinator of."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.server.gaze import GazeSettings
from handeye.server.results import CollectResult, GazeResult
from handeye.server.schemas.coordination import GridViewRequest, PosturesRequest
from handeye.server.settings import ServerSettings
from tests.modules.test_grid import drawn
from tests.server.coordinating import (
    MIDDLE,
    REGION,
    SYNERGIES,
    collect,
    fixate,
    show_cup,
    succeeded,
    teach_css,
    view,
)
from tests.server.rest import done, ended, problem
from tests.server.toys import LATENCY, PARK

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.modules.spaces import ImagePoint
    from tests.server.conftest import Lab


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
