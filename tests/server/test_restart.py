"""A coordinator that starts anew on a store is the one that was there before."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.modules.declaration import ModuleDeclaration
from handeye.modules.ijs import DECLARATION
from handeye.server.livemodules import LiveModules
from handeye.server.store.backup import backup
from handeye.server.store.check import verify
from tests.server.conftest import asking, open_lab
from tests.server.rest import NPZ, declaration, done, packed, samples, taught

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.testclient import TestClient

    from handeye.server.job import Job
    from handeye.server.store import Store

QUERIES = taught(30, seed=8)[0]


def answers(http: TestClient, module: str) -> list[dict[str, object]]:
    asked = {"inputs": QUERIES.tolist(), "neighbours": 30}
    told: list[dict[str, object]] = done(http.post(f"/v1/modules/{module}/query", json=asked))["answers"]
    return told


@pytest.mark.parametrize("method", ["local_linear", "local_quadratic", "kndb", "nearest"])
def test_modules_answer_as_before(store: Store, method: str) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        http.post("/v1/modules", json=declaration(method=method))
        for seed in range(5):
            inputs, outputs = taught(60, seed)
            body = packed(
                inputs=inputs, outputs=outputs, demonstrations=[f"d-{i % 4}" if i % 5 else "" for i in range(60)]
            )
            done(http.post("/v1/modules/map/samples", content=body, headers=NPZ), 201)
        done(http.delete("/v1/modules/map/samples", params={"demonstration": "d-2"}))
        done(http.delete("/v1/modules/map/samples", params={"number": [1, 100, 299]}))
        # Too few to be a reason to calibrate anew.
        done(http.post("/v1/modules/map/samples", json=samples(4, seed=9, demonstration="d-9")), 201)
        before, info = answers(http, "map"), done(http.get("/v1/modules/map"))
        listed = done(http.get("/v1/modules/map/samples", params={"limit": 1000}))
    with open_lab(store) as lab, asking(lab) as http:
        after = answers(http, "map")
        assert [each["output"] for each in after] == [each["output"] for each in before]
        assert [each["neighbours"] for each in after] == [each["neighbours"] for each in before]
        assert done(http.get("/v1/modules/map")) == info
        assert done(http.get("/v1/modules/map/samples", params={"limit": 1000})) == listed
        assert done(http.post("/v1/modules/map/samples", json=samples(1)), 201)["first"] == 304
        # Support compares with samples that were left out and asked for; that is done anew at the start, and when the
        # samples have grown by a quarter.
        for one, other in zip(before, after, strict=True):
            assert other["support"] == pytest.approx(one["support"], abs=0.1)


def test_support_is_to_the_last_bit_what_training_anew_gives(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        http.post("/v1/modules", json=declaration(method="kndb2", neighbours=6))
        for seed in range(3):
            http.post("/v1/modules/map/samples", json=samples(50, seed, demonstration=f"d-{seed}"))
        lab.coordinator.modules.retrain("map", None)
        before = answers(http, "map")
    with open_lab(store) as lab, asking(lab) as http:
        assert answers(http, "map") == before


def test_a_hundred_thousand_samples_are_rebuilt_in_seconds(store: Store, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(0)
    modules = LiveModules(store)
    modules.load()
    wide = ModuleDeclaration.model_validate(DECLARATION.model_dump() | {"name": "ten inputs", "approximator": {}})
    narrow = ModuleDeclaration.model_validate(declaration("two inputs"))
    with store.write():
        for declared in (wide, narrow):
            modules.create(declared)
    for declared in (wide, narrow):
        inputs = random.normal(size=(50_000, len(declared.inputs)))
        if declared is wide:
            inputs[:, 0] = np.arange(50_000) % 3
        outputs = inputs[:, :2] if declared is narrow else inputs[:, 1:7]
        for start in range(0, 50_000, 10_000):
            chunk = slice(start, start + 10_000)
            shown = [f"demonstration-{i // 50}" for i in range(start, start + 10_000)]
            modules.add(declared.name, inputs[chunk], outputs[chunk], shown)
    told: list[float] = []
    fresh = LiveModules(store)
    began = time.perf_counter()
    fresh.load(told.append)
    seconds = time.perf_counter() - began
    with capsys.disabled():
        print(f"\n100 000 samples were rebuilt in {seconds:.1f} s")
    assert seconds < 60.0
    assert told == [0.5, 1.0]
    assert fresh.live("ten inputs").samples == fresh.live("two inputs").samples == 50_000
    query = random.normal(size=10)
    query[0] = 1.0
    one, other = modules.live("ten inputs").answer(query), fresh.live("ten inputs").answer(query)
    np.testing.assert_array_equal(one.output, other.output)
    assert [each.sample_id for each in one.neighbours] == [each.sample_id for each in other.neighbours]


def test_a_module_made_while_the_others_are_loaded_is_not_lost(store: Store) -> None:
    modules = LiveModules(store)
    modules.load()
    modules.create(ModuleDeclaration.model_validate(declaration("old")))
    fresh = LiveModules(store)

    maker = threading.Thread(target=fresh.create, args=(ModuleDeclaration.model_validate(declaration("new")),))
    fresh.load(lambda _share: maker.start())
    maker.join(10.0)
    assert fresh.live("old").samples == fresh.live("new").samples == 0


def test_a_deleted_demonstration_stays_away_when_a_snapshot_comes_back(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        lab.teach([(220.0, 300.0), (260.0, 340.0)])
        lab.train()
        kept = done(http.post("/v1/modules/IJS.grasp/snapshots", json={"name": "both"}), 201)["samples"]
        assert http.delete("/v1/demonstrations/grasp-1").status_code == 204
        assert done(http.get("/v1/modules/IJS.grasp/snapshots"))["snapshots"][0]["samples"] < kept
        done(http.post("/v1/modules/IJS.grasp/snapshots/both/rollback"))
        left = done(http.get("/v1/modules/IJS.grasp/samples", params={"limit": 1000}))["samples"]
        assert {each["demonstration"] for each in left} == {"grasp-2"}
    assert verify(store.engine.url.render_as_string(hide_password=False)) == []


def test_what_a_backup_did_not_have_is_forgotten(store: Store, tmp_path: Path) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        release, began = threading.Event(), threading.Event()

        def work(_job: Job) -> None:
            began.set()
            release.wait(30.0)

        job = lab.coordinator.jobs.start("train", "grasp", None, work, acts=False)
        assert began.wait(10.0)
        backup(store, tmp_path / "backup.db")
        content = (tmp_path / "backup.db").read_bytes()
        refused = http.post("/v1/restore", content=content)
        assert (refused.status_code, refused.json()["code"]) == (409, "busy")
        release.set()
        assert job.wait(10.0)
        lab.teach([(220.0, 300.0)])
        assert set(lab.sight.learned) == {"blue cup"}
        assert done(http.post("/v1/restore", content=content)) == {"modules": 0, "samples": 0}
        assert lab.sight.learned == {}
        assert done(http.get(f"/v1/jobs/{job.id}"))["state"] == "interrupted"
