"""Sweeps that are killed at seeded instants, and bits flipped in their files.

A kill comes at an instant within a batch, at an operation on a file of the folder, or to the whole
program or one of its workers. The same run afterwards must bring every scenario, in the bytes of a
sweep that nothing interrupted. A flipped bit must change no value that any reader gives, or be one
message that names the file and what mends it; every twentieth is mended that way.
"""

import contextlib
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr
from tests.faults.sweep_process import finished, started, wait_for_batches, workers_of
from tests.unit.sweeps import batch_names, here, small_study, study_file

from benchmarks.studies.attack.forked import forked
from turnout.core.errors import FileError
from turnout.study.study import Study
from turnout.study.sweep.folder import BATCHES, IDENTITY
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_study
from turnout.study.sweep.stored_study import STUDY, load_stored_study
from turnout.study.sweep.worker import initialize_worker

COUNT = 32
KILL_EVERY, PROGRAM_EVERY, MEND_EVERY = 11, 20, 20
"""One attempt in so many is a kill; one kill in so many is of the program; one flip is mended."""
FILE_EVENTS = ("open", "os.rename", "os.remove", "os.mkdir", "os.chmod", "tempfile.mkstemp")
TRIES = 8

Record = dict[str, Any]


class Attacked:
    """A small study, and the sweep of it that nothing interrupted."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.study: Study = small_study(folder, count=COUNT)
        self.file = study_file(folder, count=COUNT)
        self.whole = folder / "whole"
        began = time.monotonic()
        throw_study(self.study, self.whole, pool=here)
        self.seconds = time.monotonic() - began
        self.names = batch_names(self.whole)
        self.dataset: xr.Dataset = open_batches(self.whole).load()
        self.events = _count_events(self)

    def check_whole(self, folder: Path) -> None:
        """Find each scenario once, in the same bytes; names hold digests of them."""
        assert batch_names(folder) == self.names, "batches are lost, doubled or others"
        found = open_batches(folder).load()
        xr.testing.assert_identical(found, self.dataset)
        assert not list((folder / BATCHES).glob(".*")), "leftovers"

    def check_part(self, folder: Path) -> None:
        """Find the results of the whole sweep in a killed one, or one message with the remedy."""
        try:
            found = read_labels(folder)
        except FileError as error:
            if len(str(error).splitlines()) > 1:
                raise AssertionError(str(error)) from None
            return
        for scenario in found["scenario"].values:
            wanted = self.dataset.drop_dims("time").sel(scenario=scenario)
            xr.testing.assert_equal(found.sel(scenario=scenario), wanted)


@contextmanager
def attacking(seed: int) -> Iterator[Callable[[int], Record]]:
    """Provide a function that makes an attempt on a sweep by its number."""
    initialize_worker()
    with tempfile.TemporaryDirectory(prefix="attack on sweeps ") as folder:
        attacked = Attacked(Path(folder))
        spoilt = Path(shutil.copytree(attacked.whole, Path(folder) / "spoilt"))

        def attempt(index: int) -> Record:
            source = random.Random(f"{seed}-{index}")
            before = resource.getrusage(resource.RUSAGE_SELF)
            began = time.monotonic()
            if index % KILL_EVERY == 0:
                place = Path(tempfile.mkdtemp(dir=folder)) / "sweep"
                number = index // KILL_EVERY
                record = _judged(lambda: _killed(attacked, place, source, number))
                shutil.rmtree(place.parent)
            else:
                record = _judged(lambda: _flipped(attacked, spoilt, source, index))
                if record["outcome"] == "fault":
                    shutil.rmtree(spoilt)
                    shutil.copytree(attacked.whole, spoilt)
            after = resource.getrusage(resource.RUSAGE_SELF)
            assert after.ru_maxrss >= before.ru_maxrss
            seconds = round(time.monotonic() - began, 3)
            return {"index": index, "seconds": seconds, "memory": after.ru_maxrss / 1024, **record}

        yield attempt


def _judged(attack: Callable[[], Record]) -> Record:
    try:
        return attack()
    except Exception as error:  # whatever a reader raises but its own error is a fault
        text = f"{type(error).__name__}: {error}"
        return {"kind": "unknown", "outcome": "fault", "text": text[:3000]}


def _killed(attacked: Attacked, place: Path, source: random.Random, number: int) -> Record:
    if number % PROGRAM_EVERY == 0:
        return _program_killed(attacked, place, source)
    at_file = source.random() < 0.4
    for _ in range(TRIES):
        if at_file:
            kind, dead = "kill at a file operation", _killed_at_file(attacked, place, source)
        else:
            kind, dead = "kill within a batch", _killed_in_batch(attacked, place, source)
        if dead:
            break
        shutil.rmtree(place, ignore_errors=True)
    else:
        return {"kind": kind, "outcome": "answered", "late": True}
    record: Record = {"kind": kind, "outcome": "answered", "batches": len(_batches(place))}
    if place.exists():
        attacked.check_part(place)
    kept = {path: path.stat().st_mtime_ns for path in _batches(place)}
    throw_study(attacked.study, place, pool=here)
    attacked.check_whole(place)
    again = [path.name for path, stamp in kept.items() if path.stat().st_mtime_ns != stamp]
    assert not again, f"what was written was thrown again: {again}"
    return record


def _batches(place: Path) -> list[Path]:
    return sorted((place / BATCHES).glob("[0-9]*.nc"))


def _throw(attacked: Attacked, place: Path) -> None:
    throw_study(attacked.study, place, pool=here)


def _killed_in_batch(attacked: Attacked, place: Path, source: random.Random) -> bool:
    """Kill a run after some batches and a part of one more; return whether it was under way."""
    batches = len(attacked.names)
    after = source.randrange(batches)
    share = source.random() * attacked.seconds / batches
    pid = forked(partial(_throw, attacked, place))
    due = time.monotonic() + 60
    while time.monotonic() < due and os.waitpid(pid, os.WNOHANG) == (0, 0):
        if (place / IDENTITY).exists() and len(_batches(place)) >= after:
            time.sleep(share)
            os.kill(pid, signal.SIGKILL)
            _, status = os.waitpid(pid, 0)
            killed = os.waitstatus_to_exitcode(status) == -signal.SIGKILL
            return killed and len(_batches(place)) < batches
        time.sleep(0.001)
    return False


def _killed_at_file(attacked: Attacked, place: Path, source: random.Random) -> bool:
    """Let a run kill itself before an operation on a file of its folder."""
    at = source.randrange(attacked.events)

    def throw() -> None:
        seen = 0

        def hook(event: str, given: tuple[Any, ...]) -> None:
            nonlocal seen
            if event in FILE_EVENTS and given and str(place) in str(given[0]):
                seen += 1
                if seen > at:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        _throw(attacked, place)

    _, status = os.waitpid(forked(throw), 0)
    return os.waitstatus_to_exitcode(status) == -signal.SIGKILL


def _count_events(attacked: Attacked) -> int:
    """Return how many operations on files a run makes in its folder."""
    place, reported = attacked.folder / "counted", attacked.folder / "events"

    def throw() -> None:
        seen = 0

        def hook(event: str, given: tuple[Any, ...]) -> None:
            nonlocal seen
            seen += event in FILE_EVENTS and bool(given) and str(place) in str(given[0])

        sys.addaudithook(hook)
        _throw(attacked, place)
        reported.write_text(str(seen))

    _, status = os.waitpid(forked(throw), 0)
    assert status == 0
    return int(reported.read_text())


def _program_killed(attacked: Attacked, place: Path, source: random.Random) -> Record:
    """Kill the program or one of its two workers, then let it go on."""
    process = started(attacked.file, place)
    wait_for_batches(process, place, source.randrange(len(attacked.names) - 1))
    time.sleep(source.random() * attacked.seconds / len(attacked.names))
    workers = workers_of(process.pid)
    alone = source.random() < 0.4 and bool(workers)
    with contextlib.suppress(ProcessLookupError):
        if alone:
            os.kill(source.choice(workers), signal.SIGKILL)
            time.sleep(source.random() * 0.5)
        process.kill()
    late = process.wait() != -signal.SIGKILL
    process.communicate()
    # The folder is locked until the workers have seen that the run is gone.
    time.sleep(0.5)
    there = len(_batches(place))
    if place.exists():
        attacked.check_part(place)
    said = finished(attacked.file, place, "--workers", "1")
    assert "Traceback" not in said, said
    attacked.check_whole(place)
    kind = "kill of the program and a worker" if alone else "kill of the program"
    return {"kind": kind, "outcome": "answered", "batches": there, "late": late}


def _flipped(attacked: Attacked, spoilt: Path, source: random.Random, index: int) -> Record:
    paths = [spoilt / IDENTITY, spoilt / STUDY, *_batches(spoilt)]
    path = source.choice(paths)
    kind = f"bit flip in {'a batch' if path.suffix == '.nc' else path.name}"
    content = path.read_bytes()
    bit = source.randrange(8 * len(content))
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    path.write_bytes(changed)
    load_stored_study.cache_clear()
    said, outcome = "", "answered"
    try:
        xr.testing.assert_identical(open_batches(spoilt).load(), attacked.dataset)
        xr.testing.assert_identical(read_labels(spoilt), attacked.dataset.drop_dims("time"))
        kept = load_stored_study(spoilt, attacked.study.digest)
        assert kept.digest == attacked.study.digest
        assert kept.panel.hash == attacked.study.panel.hash
        assert kept.scenario(5) == attacked.study.scenario(5)
    except FileError as error:
        said, outcome = str(error), "refused"
        if str(path) not in said or "sweep run" not in said or len(said.splitlines()) > 1:
            return {"kind": kind, "outcome": "fault", "text": f"bit {bit} of {path.name}: {said}"}
    if outcome == "refused" and index % MEND_EVERY == 0:
        throw_study(attacked.study, spoilt, pool=here)
        attacked.check_whole(spoilt)
        assert path.read_bytes() == content, "mended to other bytes"
    else:
        path.write_bytes(content)
    load_stored_study.cache_clear()
    return {"kind": kind, "outcome": outcome}
