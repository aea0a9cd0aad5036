"""A stack that is taught to pour: five subtasks towards two objects, one of them along a way that nobody looks at."""

from __future__ import annotations

import pytest

from handeye.cli.up import Stack
from handeye.client import Client
from handeye.rpc import Bus
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import pour
from handeye.simulation.objects import CUPS, JAR
from handeye.simulation.places import Purpose
from handeye.simulation.scoring_two import POUR_SUBTASKS, score_pour
from handeye.simulation.teaching import lab_settings, place, teach

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

CUP = CUPS["blue cup"]
SEED = 3


def test_it_is_shown_twice_then_the_robot_pours_what_was_never_in_the_cup_before(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    lesson = pour(CUP)
    with (
        Stack(tmp_path_factory.mktemp("pour")) as stack,
        Client(stack.url, stack.token) as client,
        Bus.open(lab_settings(stack.lab), name="tests") as bus,
    ):
        teach(
            demonstrations=2,
            seed=SEED,
            task="tea",
            object_name=CUP.name,
            state_dir=stack.state_dir,
            watch_parent=False,
            lesson="pour",
        )
        subtasks = client.task("tea").subtasks
        assert [(each.name, each.object, len(each.way), each.action) for each in subtasks] == [
            ("approach", None, 0, None),
            ("grasp", None, 0, "close_gripper"),
            ("delivery", JAR.name, 0, None),
            ("pour", JAR.name, 6, None),
            ("replace", JAR.name, 0, "open_gripper"),
        ]
        lab = LabClient(bus)
        places = lesson.draw(SEED, Purpose.TEACHING, 1)[0]
        cup, jar = places
        place(
            object_name=CUP.name,
            at=(cup.x, cup.y),
            seed=11,  # another world: other noise, another rest of the joints in their play
            state_dir=stack.state_dir,
            beside=(JAR.name, jar.x, jar.y),
            liquid=20,  # it was shown with an empty cup
        )
        begun = lab.world().world_time
        job = client.run_task("tea", CUP.name).raise_for_failure()
        ended = {each.name: each.ended for each in job.result.subtasks if each.ended is not None}
        found = score_pour(lab.history(begun, every=0.05), CUP, JAR, ended)
        assert found.passed == dict.fromkeys(POUR_SUBTASKS, True)
        assert found.arrived >= 0.9
        poured = job.result.subtasks[3]
        assert poured.object == JAR.name
        assert len(poured.way) == 6
        parts = job.result.subtasks
        looked = {n.demonstration for part in parts for look in part.looks for n in look.neighbours}
        followed = {n.demonstration for part in parts for passed in part.way for n in passed.neighbours}
        assert looked | followed == {"tea-1", "tea-2"}
        assert {n.demonstration for n in poured.way[0].neighbours} <= {"tea-1", "tea-2"}
