"""Jobs: progress, events, cancel, and what of them survives."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from sqlalchemy.exc import OperationalError

from handeye.server.job import Job
from handeye.server.jobs import JobBusy, Jobs
from handeye.server.problem import NotFound
from handeye.server.results import HeadInfo, JobState
from handeye.server.store import Store
from tests.server.conftest import asking, open_lab
from tests.server.rest import broken, declaration, done, ended, problem, samples

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab

RESULT = HeadInfo(pan=0.5, tilt=0.0, moving=False, world_time=1.0)


@pytest.fixture
def jobs(store: Store) -> Iterator[Jobs]:
    with closing(Jobs(store, kept=100)) as opened:
        yield opened


@contextmanager
def closing(jobs: Jobs) -> Iterator[Jobs]:
    try:
        yield jobs
    finally:
        jobs.close()


class Gate:
    """Work that waits until it may end, or is cancelled."""

    def __init__(self, work: Callable[[Job], None] = lambda _job: None) -> None:
        self.begun = threading.Event()
        self.open = threading.Event()
        self._work = work

    def __call__(self, job: Job) -> None:
        self.begun.set()
        while not self.open.wait(0.01):
            job.check()
        self._work(job)


def start(jobs: Jobs, work: Callable[[Job], None], *, acts: bool = False) -> Job:
    return jobs.start("run" if acts else "train", "grasp", None, work, acts=acts)


def kinds(job: Job) -> list[str]:
    return [each.kind for each in job.events(0, 0.0)]


# --- one job --------------------------------------------------------------------------------------------------------


def test_a_job_tells_its_progress_and_its_end(jobs: Jobs) -> None:
    def work(job: Job) -> None:
        for share in (0.0, 0.001, 0.5, 0.501, 1.0, 1.0, 7.0):
            job.report(share)
        job.finish(RESULT)

    job = start(jobs, work)
    assert job.wait(10.0)
    view = job.view()
    assert (view.state, view.progress, view.result, view.error) == ("succeeded", 1.0, RESULT, None)
    assert view.started is not None
    assert view.ended is not None
    assert view.created <= view.started <= view.ended
    told = job.events(0, 0.0)
    assert [each.number for each in told] == list(range(1, len(told) + 1))
    assert [each.data["progress"] for each in told if each.kind == "progress"] == [0.0, 0.5, 1.0]
    assert [each.data["state"] for each in told if each.kind == "state"] == ["running", "succeeded"]


def test_what_nobody_foresaw_fails_the_job_without_details(jobs: Jobs) -> None:
    job = start(jobs, lambda _job: 1 / 0)  # type: ignore[arg-type]
    assert job.wait(10.0)
    error = job.view().error
    assert error is not None
    assert (job.view().state, error.code) == ("failed", "internal")
    assert "division" not in error.message


def test_jobs_that_do_not_act_take_turns_and_a_queued_one_can_be_cancelled(jobs: Jobs) -> None:
    gate, second = Gate(), Gate()
    first = start(jobs, gate)
    assert gate.begun.wait(10.0)
    queued = start(jobs, second)
    assert queued.view().state == "queued"
    queued.cancel()
    assert queued.wait(10.0)
    assert (queued.view().state, second.begun.is_set()) == ("cancelled", False)
    assert queued.view().started is None
    assert not first.ended
    gate.open.set()
    assert first.wait(10.0)


def test_one_job_acts_at_a_time(jobs: Jobs) -> None:
    gate = Gate()
    acting = start(jobs, gate, acts=True)
    with pytest.raises(JobBusy, match=acting.id):
        start(jobs, gate, acts=True)
    gate.open.set()
    assert acting.wait(10.0)
    gate.open.set()
    assert start(jobs, gate, acts=True).wait(10.0)


def test_a_job_starts_only_when_its_transaction_is_committed(store: Store, jobs: Jobs) -> None:
    gate = Gate()
    with store.write():
        job = start(jobs, gate)
        assert not gate.begun.wait(0.1)
        gate.open.set()
    assert job.wait(10.0)
    undone = []

    def fail() -> None:
        with store.write():
            undone.append(start(jobs, gate))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(NotFound):
        jobs.get(undone[0].id)
    assert jobs.acting is None


def test_whoever_asks_between_commit_and_start_follows_the_same_job(store: Store, jobs: Jobs) -> None:
    """The job is in the store before it is among those under way."""
    gate = Gate()
    found: list[Job] = []
    with store.write():
        job = jobs.start("train", "grasp", None, gate, acts=False)
        begin = store._callbacks.pop()
        asker = threading.Thread(target=lambda: found.append(jobs.get(job.id)))

        def late() -> None:
            asker.start()
            asker.join(0.2)  # it waits, or has got what it must not get
            begin()

        store.afterwards(late)
    asker.join(10.0)
    assert found == [job]
    gate.open.set()
    assert job.wait(10.0)


def test_events_come_as_they_happen_and_a_number_of_another_process_loses_nothing(jobs: Jobs) -> None:
    gate = Gate()
    job = start(jobs, gate)
    assert gate.begun.wait(10.0)
    assert [each.kind for each in job.events(0, 10.0)] == ["state"]
    assert job.events(1, 0.0) == ()
    gate.open.set()
    assert job.wait(10.0)
    assert [each.data["state"] for each in job.events(1, 0.0)] == ["succeeded"]
    # Progress has numbers that the store does not know: who heard of them before a restart still hears of the end.
    assert [each.data["state"] for each in job.events(57, 0.0)] == ["succeeded"]


def test_an_undone_result_is_not_told(store: Store, jobs: Jobs) -> None:
    def work(job: Job) -> None:
        with broken(store), pytest.raises(OperationalError):
            job.publish("look", {"number": 0}, RESULT)
        job.publish("look", {"number": 1}, RESULT.model_copy(update={"pan": 0.7}))

    job = start(jobs, work)
    assert job.wait(10.0)
    assert [each.data["number"] for each in job.events(0, 0.0) if each.kind == "look"] == [1]


def test_a_job_whose_end_cannot_be_written_has_ended_nevertheless(store: Store, jobs: Jobs) -> None:
    gate = Gate()
    job = start(jobs, gate)
    assert gate.begun.wait(10.0)
    with broken(store):
        gate.open.set()
        assert job.wait(10.0)
    assert job.view().state == "succeeded"
    assert jobs.get(job.id).view().state == "succeeded"  # not "running", as the store has it
    assert jobs.page(None, 10)[0][0].state == "succeeded"
    jobs.require_none()
    again = start(jobs, gate)
    assert again.wait(10.0)


# --- many jobs ------------------------------------------------------------------------------------------------------


def test_a_job_whose_thread_does_not_start_has_ended(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", refuse)
        job = start(jobs, lambda _job: None, acts=True)
    assert job.view().state is JobState.CANCELLED
    jobs.require_none()
    assert start(jobs, lambda _job: None, acts=True).wait(5.0)


def test_an_event_without_a_result_leaves_the_result(jobs: Jobs) -> None:
    def work(job: Job) -> None:
        job.publish("look", {"number": 0}, RESULT)
        job.publish("look", {"number": 1}, None)

    job = start(jobs, work)
    assert job.wait(5.0)
    assert job.view().result == RESULT
    assert [each.data for each in job.events(0, 0.0) if each.kind == "look"] == [{"number": 0}, {"number": 1}]


def test_jobs_come_newest_first_in_pages(jobs: Jobs) -> None:
    made = []
    for _ in range(5):
        made.append(start(jobs, lambda _job: None))
        assert made[-1].wait(10.0)
    newest, more = jobs.page(None, 2)
    assert [view.id for view in newest] == [made[4].id, made[3].id]
    older, more = jobs.page(more, 2)
    assert [view.id for view in older] == [made[2].id, made[1].id]
    oldest, more = jobs.page(more, 2)
    assert ([view.id for view in oldest], more) == ([made[0].id], None)
    assert jobs.page(None, 5)[1] is None


def test_only_the_newest_are_kept_but_none_under_way_is_forgotten(store: Store) -> None:
    gate = Gate(lambda job: job.publish("look", {}, RESULT))
    with closing(Jobs(store, kept=2)) as jobs:
        acting = start(jobs, gate, acts=True)
        assert gate.begun.wait(10.0)
        others = []
        for _ in range(4):
            others.append(start(jobs, lambda _job: None))
            assert others[-1].wait(10.0)
        kept = {view.id for view in jobs.page(None, 100)[0]}
        assert acting.id in kept
        assert others[-1].id in kept
        assert others[0].id not in kept
        with pytest.raises(NotFound, match="newest 2"):
            jobs.get(others[0].id)
        gate.open.set()
        assert acting.wait(10.0)
        assert acting.view().state == "succeeded"


def test_a_list_of_jobs_does_not_mind_that_some_are_forgotten_meanwhile(store: Store) -> None:
    with closing(Jobs(store, kept=3)) as jobs:
        stop = threading.Event()

        def go_on() -> None:
            while not stop.is_set():
                start(jobs, lambda _job: None).wait(10.0)

        maker = threading.Thread(target=go_on)
        maker.start()
        try:
            for _ in range(100):
                jobs.page(None, 10)
        finally:
            stop.set()
            maker.join(10.0)


def test_after_closing_nothing_starts_also_not_what_was_being_committed(store: Store) -> None:
    jobs, gate = Jobs(store, kept=10), Gate()
    with store.write():
        late = start(jobs, gate)
        closer = threading.Thread(target=jobs.close)
        closer.start()
        closer.join(0.2)
    closer.join(10.0)
    assert late.wait(10.0)
    assert late.view().state == "cancelled"
    assert not gate.begun.is_set()
    with pytest.raises(JobBusy, match="shutting down"):
        start(jobs, gate)


def test_closing_cancels_what_is_under_way_and_what_waits(store: Store) -> None:
    jobs, gate = Jobs(store, kept=10), Gate()
    under_way, queued = start(jobs, gate), start(jobs, gate)
    assert gate.begun.wait(10.0)
    jobs.close()
    assert [job.view().state for job in (under_way, queued)] == ["cancelled", "cancelled"]


# --- over REST, and after a restart ---------------------------------------------------------------------------------


def test_what_became_of_a_job_survives_a_restart(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        at = done(http.post("/v1/modules", json=declaration()), 201)["name"]
        http.post(f"/v1/modules/{at}/samples", json=samples(40))
        job = ended(http, http.post(f"/v1/modules/{at}/train"))
        assert (job["state"], job["progress"], job["result"]["samples"]) == ("succeeded", 1.0, 40)
        events = http.get(f"/v1/jobs/{job['id']}/events").text
    with open_lab(store) as lab, asking(lab) as http:
        assert done(http.get(f"/v1/jobs/{job['id']}")) == job
        states = [line for line in events.splitlines() if '"state":' in line]
        again = [line for line in http.get(f"/v1/jobs/{job['id']}/events").text.splitlines() if '"state":' in line]
        assert again == states
        assert [each["id"] for each in done(http.get("/v1/jobs"))["jobs"]] == [job["id"]]
        assert done(http.post(f"/v1/jobs/{job['id']}/cancel"), 202)["state"] == "succeeded"


def test_a_job_that_a_restart_cut_off_says_so(store: Store) -> None:
    first, gate = Jobs(store, kept=10), Gate()
    cut = start(first, lambda job: (job.publish("look", {"number": 0}, RESULT), gate(job))[0])  # type: ignore[func-returns-value]
    waiting = start(first, gate)
    assert gate.begun.wait(10.0)
    with open_lab(store) as lab, asking(lab) as http:  # as after kill -9: the first process never ended them
        for job in (cut, waiting):
            told = done(http.get(f"/v1/jobs/{job.id}"))
            assert (told["state"], told["error"]["code"]) == ("interrupted", "interrupted")
            assert told["ended"] is not None
        assert done(http.get(f"/v1/jobs/{cut.id}"))["result"] == RESULT.model_dump()
        stream = http.get(f"/v1/jobs/{cut.id}/events", headers={"Last-Event-ID": "57"})
        assert '"interrupted"' in stream.text
        assert http.get(f"/v1/jobs/{cut.id}/events").text.count("event: look") == 1
    first.close()


def test_training_as_a_job_that_is_cancelled_leaves_the_module_alone(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(30))
    before = done(http.get("/v1/modules/map"))
    begun, go_on = threading.Event(), threading.Event()
    built = lab.coordinator.modules._built

    def slow(*arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(10.0)
        return built(*arguments)

    monkeypatch.setattr(lab.coordinator.modules, "_built", slow)
    accepted = http.post("/v1/modules/map/train", json={"approximator": {"method": "nearest"}})
    assert begun.wait(10.0)
    # Writes go on while it is built.
    done(http.post("/v1/modules", json=declaration("other")), 201)
    http.post(f"{accepted.headers['location']}/cancel")
    go_on.set()
    job = ended(http, accepted)
    assert job["state"] == "cancelled"
    assert done(http.get("/v1/modules/map")) == before


def test_training_goes_by_the_samples_that_came_meanwhile(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(30))
    modules = lab.coordinator.modules
    built, times = modules._built, 0

    def disturbed(*arguments: Any) -> Any:
        nonlocal times
        module = built(*arguments)
        times += 1
        if times < 3:  # in the last attempt nothing comes between
            done(http.post("/v1/modules/map/samples", json=samples(1, seed=times)), 201)
        return module

    monkeypatch.setattr(modules, "_built", disturbed)
    job = ended(http, http.post("/v1/modules/map/train", json={"approximator": {"method": "nearest"}}))
    assert (job["state"], job["result"]["samples"], times) == ("succeeded", 32, 3)
    assert modules.live("map").samples == 32
    assert modules.live("map").declaration.approximator.method == "nearest"
    assert modules.stored("map").declaration.approximator.method == "nearest"


def test_jobs_of_unknown_modules_and_jobs_that_are_none(http: TestClient) -> None:
    problem(http.post("/v1/modules/nobody/train"), 404, "not_found")
    for path in ("", "/events", "/looks/0.jpg"):
        problem(http.get(f"/v1/jobs/none{path}"), 404, "not_found")
    problem(http.post("/v1/jobs/none/cancel"), 404, "not_found")


def test_many_followers_do_not_hold_up_each_other(lab: Lab, http: TestClient) -> None:
    gate = Gate()
    job = lab.coordinator.jobs.start("train", "grasp", None, gate, acts=False)
    streams: list[str] = []
    followers = [
        threading.Thread(target=lambda: streams.append(http.get(f"/v1/jobs/{job.id}/events").text)) for _ in range(30)
    ]
    for follower in followers:
        follower.start()
    assert gate.begun.wait(10.0)
    assert done(http.get("/healthz")) == {"status": "ok"}
    gate.open.set()
    for follower in followers:
        follower.join(3.0)
    assert len(streams) == 30
    assert all(text.count("event: state") == 2 for text in streams)


def test_states_are_what_the_document_says() -> None:
    assert {state.value for state in JobState} == {
        *("queued", "running", "succeeded", "failed", "cancelled", "interrupted")
    }
