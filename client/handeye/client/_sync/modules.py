# Made by tools/make_sync.py from client/handeye/client/_async/modules.py: change that, then `make sync`.
"""Modules: declare them, teach them samples, ask them, look into them, keep them."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.client import _arrays
from handeye.client._arrays import NPZ, QueryAnswers
from handeye.client._foreign import parse, readable
from handeye.client._job_models import OnEvent, TrainJob
from handeye.client._module_models import (
    Declaration,
    ModuleInfo,
    Modules,
    ModuleStatistics,
    Removed,
    Sample,
    SamplesAdded,
    SamplesPage,
    Snapshot,
    Snapshots,
    Tree,
)
from handeye.client._sync.calls import key, part
from handeye.client._sync.jobs import SyncJobCalls, ignore
from handeye.client.errors import HandeyeError, PartlyAdded, UnexpectedAnswer

_MOST_NUMBERS = 1000
"""So many samples are named at once."""


class SyncModuleCalls(SyncJobCalls):
    """The part of the client for /v1/modules."""

    def create_module(self, declaration: Declaration | Mapping[str, Any]) -> ModuleInfo:
        """A new module as it is declared: {"name", "inputs", "outputs", "approximator"}."""
        if isinstance(declaration, Declaration):
            declaration = declaration.model_dump(mode="json", exclude_none=True)
        return self._post_once(ModuleInfo, "/v1/modules", declaration)

    def modules(self) -> tuple[ModuleInfo, ...]:
        """All modules."""
        with closing(self._pages(Modules, "/v1/modules")) as pages:
            return tuple([module for page in pages for module in page.modules])

    def module(self, name: str) -> ModuleInfo:
        """One module."""
        return self._get(ModuleInfo, _path(name))

    def delete_module(self, name: str) -> None:
        """Deletes a module with its samples and snapshots."""
        self._delete(_path(name))

    # Samples

    def add_samples(
        self, module: str, inputs: ArrayLike, outputs: ArrayLike, demonstrations: str | Sequence[str] | None = None
    ) -> NDArray[np.int64]:
        """Teaches samples and returns their numbers (n,), in order; queries answer from them at once.

        Args:
            module: its name.
            inputs: (n, N) in the declared order and units.
            outputs: (n, M) in the declared order and units.
            demonstrations: where they come from, n names or one for all.

        Raises:
            WrongArrays: the arrays do not fit each other or are not finite; nothing was sent.
            PartlyAdded: large n is sent in batches, and one of them failed after others were kept.
        """
        given = _arrays.samples(inputs, outputs, demonstrations)
        numbers: list[NDArray[np.int64]] = []
        for some in _arrays.batches(given.inputs, given.outputs):
            try:
                added = self._add(module, _arrays.encode_samples(given, some))
            except HandeyeError as error:
                if numbers:
                    raise PartlyAdded(np.concatenate(numbers), len(given.inputs), error) from error
                raise
            numbers.append(np.arange(added.first, added.first + added.count, dtype=np.int64))
        return np.concatenate(numbers)

    def _add(self, module: str, content: bytes) -> SamplesAdded:
        headers = {"Content-Type": NPZ, **key()}
        path = f"{_path(module)}/samples"
        answer = self._call("POST", path, content=content, headers=headers, retries=self._retries)
        return parse(SamplesAdded, answer.content, self._url)

    def samples(self, module: str) -> Generator[Sample]:
        """A module's samples, by their numbers; asked for as they are wanted."""
        with closing(self._pages(SamplesPage, f"{_path(module)}/samples", {"limit": "1000"})) as pages:
            for page in pages:
                yield from page.samples

    def remove_samples(self, module: str, numbers: Sequence[int] = (), *, demonstration: str | None = None) -> int:
        """Takes samples out, by their numbers or all of a demonstration; returns how many it were.

        `ApiError` when one is not there. Numbers are sent a thousand at a time; each thousand goes as a whole or stays.
        """
        if demonstration is not None:
            return self._remove(module, {"demonstration": demonstration})
        texts = [str(int(number)) for number in numbers]
        parts = [texts[start : start + _MOST_NUMBERS] for start in range(0, len(texts), _MOST_NUMBERS)]
        return sum([self._remove(module, {"number": some}) for some in parts])

    def _remove(self, module: str, which: Mapping[str, str | list[str]]) -> int:
        # Once: of a repeated one it could not be told whether the samples were gone before.
        answer = self._call("DELETE", f"{_path(module)}/samples", params=which)
        return parse(Removed, answer.content, self._url).removed

    # Queries

    def query(self, module: str, inputs: ArrayLike, neighbours: int = 10) -> QueryAnswers:
        """What the module says to `inputs`, (q, N) or one of (N,), with the `neighbours` nearest samples of each.

        `ApiError` with code "not_taught" when a query's category has no samples.
        """
        array = np.asarray(inputs)
        rows = _arrays.matrix(array[np.newaxis] if array.ndim == 1 else array, "queries")
        return _arrays.join([self._ask(module, rows[some], neighbours) for some in _arrays.batches(rows)])

    def _ask(self, module: str, rows: NDArray[np.float64], neighbours: int) -> QueryAnswers:
        content = _arrays.encode({"inputs": rows, "neighbours": np.array(neighbours)})
        headers = {"Content-Type": NPZ, "Accept": NPZ}
        path = f"{_path(module)}/query"
        answer = self._call("POST", path, content=content, headers=headers, retries=self._retries)
        with readable(self._url):
            return _arrays.decode_answers(answer.content)

    # What was learned

    def train_module(
        self,
        name: str,
        approximator: Mapping[str, Any] | None = None,
        *,
        timeout: float = 600.0,
        on_event: OnEvent = ignore,
    ) -> ModuleStatistics:
        """Builds a module anew from its samples, with another approximator if one is given; waits for it.

        `JobFailed` when it fails; when the wait ends early, the training is cancelled and the module stays as it was.
        """
        job = self.start_module_training(name, approximator)
        result = (self._see_through(job, timeout, on_event)).raise_for_failure().result
        if not isinstance(result, ModuleStatistics):
            raise UnexpectedAnswer(f"Job {job.id} has trained module '{name}' and has no statistics of it.")
        return result

    def start_module_training(self, name: str, approximator: Mapping[str, Any] | None = None) -> TrainJob:
        """As `train_module`, and returns at once."""
        body = {"approximator": None if approximator is None else dict(approximator)}
        return self._post_once(TrainJob, f"{_path(name)}/train", body)

    def statistics(self, module: str) -> ModuleStatistics:
        """What was learned, by category."""
        return self._get(ModuleStatistics, f"{_path(module)}/statistics")

    def tree(self, module: str, category: Sequence[float] = ()) -> Tree:
        """The structure of a module's tree; `category` is needed when it has several."""
        query = {"category": [repr(float(value)) for value in category]} if len(category) else None
        return self._get(Tree, f"{_path(module)}/tree", query)

    # Kept states

    def snapshots(self, module: str) -> tuple[Snapshot, ...]:
        """A module's snapshots, oldest first."""
        return (self._get(Snapshots, f"{_path(module)}/snapshots")).snapshots

    def take_snapshot(self, module: str, name: str) -> Snapshot:
        """Remembers a module's samples and declaration under `name`."""
        return self._post_once(Snapshot, f"{_path(module)}/snapshots", {"name": name})

    def roll_back(self, module: str, snapshot: str) -> ModuleInfo:
        """Makes a module what it was when the snapshot was taken."""
        # Once: a repeated one would also take back what was taught in between.
        return self._post(ModuleInfo, f"{_path(module)}/snapshots/{part(snapshot)}/rollback")

    def delete_snapshot(self, module: str, snapshot: str) -> None:
        """Forgets a snapshot; the module stays as it is."""
        self._delete(f"{_path(module)}/snapshots/{part(snapshot)}")

    def export_module(self, name: str, file: Path) -> None:
        """Writes a module with its samples into an .npz file, which numpy reads too."""
        self._download(f"{_path(name)}/export", file)

    def import_module(self, file: Path, name: str | None = None) -> ModuleInfo:
        """A module from the file of an export, under its own name or a new one."""
        query = None if name is None else {"name": name}
        answer = self._upload("/v1/modules/import", file, NPZ, query)
        return parse(ModuleInfo, answer.content, self._url)


def _path(module: str) -> str:
    return f"/v1/modules/{part(module)}"
