"""The folder of a sweep: its owner, its writers, and its content."""

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from itertools import chain, count
from pathlib import Path

from turnout.core.errors import FileError
from turnout.core.files import is_leftover, make_folder, refuse_file, write_atomic, write_fault
from turnout.core.json_files import from_plain, read_sealed, sealed_json, to_plain
from turnout.core.provenance import version
from turnout.core.sources import THROWS, digest_of_sources
from turnout.core.toml import read_bytes
from turnout.study.design import DesignSummary
from turnout.study.study import Study
from turnout.study.sweep.batch import BATCH_NAME, BatchOrigin, list_batches, plan_batches
from turnout.study.sweep.stored_study import STUDY
from turnout.study.sweep.verify import content_fault, open_verified

STORE_VERSION = 2
"""Of the form of the folder; form 1 kept the study as a pickle, and batches did not say whose they
are."""

IDENTITY, BATCHES, LOCK, JOURNAL, CARD = "sweep.json", "batches", ".lock", "log", "README.md"
DAMAGED = "damaged"
"""Folder that damaged files are moved to."""

LARGEST_IDENTITY = 50_000_000
"""So much of `sweep.json` is read [bytes]."""

_OWN_FILES = re.compile("|".join(map(re.escape, (IDENTITY, STUDY, CARD))))


@dataclass(frozen=True, slots=True)
class Identity:
    """Self-description of a folder.

    Attributes
    ----------
    store_version : int
        Of the form of the folder.
    study : str
        Digest of all that determines the results.
    name, description, panel : str
        Of the study, for people.
    version, code : str
        Of the program that made it, and a digest of its sources.
    seed, count, batches : int
        Seed, scenarios and batches of the study.
    interval : float
        Between kept instants [s].
    scheme : str
        In words.
    design : str
        How scenarios were drawn, as JSON; what an analysis of the results must know.
    """

    store_version: int
    study: str
    name: str
    description: str
    panel: str
    version: str
    code: str
    seed: int
    count: int
    batches: int
    interval: float
    scheme: str
    design: str

    @property
    def origin(self) -> BatchOrigin:
        """Origin that each batch of the folder must have, except for its number."""
        return BatchOrigin(study=self.study, version=self.version, code=self.code, batch="")


def study_identity(study: Study) -> Identity:
    """Return the identity that the folder of a study must have."""
    return Identity(
        store_version=STORE_VERSION,
        study=study.digest,
        name=study.name,
        description=study.description,
        panel=study.panel.name,
        version=version(),
        code=digest_of_sources(THROWS),
        seed=study.seed,
        count=study.count,
        batches=len(plan_batches(study)),
        interval=study.output.interval,
        scheme=study.scheme.describe(),
        design=json.dumps(to_plain(study.design.summary())),
    )


def claim_folder(folder: Path, wanted: Identity, *, text: str) -> None:
    """Make a folder that of a study, or find that it is; call this under its lock.

    Parameters
    ----------
    folder : Path
        Of the sweep.
    wanted : Identity
        Of the study to throw.
    text : str
        The study as `serialize_study` gives it.

    Raises
    ------
    FileError
        When it is that of another study or version, or holds something else; it is not touched.
    """
    check_folder(folder, wanted)
    try:
        (folder / BATCHES).mkdir(exist_ok=True)
    except OSError as error:
        message = f"{folder / BATCHES}: cannot be made ({error.strerror}); name another folder"
        raise FileError(message) from None
    path = folder / IDENTITY
    damaged = path.exists() and _load_identity(path)[0] is None
    if damaged:
        write_atomic(_free_path(folder, IDENTITY), read_bytes(path, largest=LARGEST_IDENTITY))
    if damaged or not path.exists():
        write_atomic(path, sealed_json(asdict(wanted)))
    write_atomic(folder / STUDY, text)


def check_folder(folder: Path, wanted: Identity) -> None:
    """Refuse a folder that is not empty and not that of a study, before anything is made.

    A damaged `sweep.json` is no reason where the batches themselves say that they are of this
    study; `claim_folder` replaces it.

    Raises
    ------
    FileError
        Naming what is there and the remedy.
    """
    refuse_file(folder)
    path = folder / IDENTITY
    if path.exists():
        found, fault = _load_identity(path)
        if found is not None:
            _refuse_other(folder, found, wanted)
        elif not _has_own_batches(folder, wanted):
            message = (
                f"{path}: {fault}, and no batch shows that the folder is of this study; "
                "run the study in another folder"
            )
            raise FileError(message)
    elif folder.is_dir() and (strangers := _foreign_files(folder)):
        message = (
            f"{folder}: is not empty and holds no sweep ({strangers[0].name} is there); "
            "name another folder"
        )
        raise FileError(message)


def _has_own_batches(folder: Path, wanted: Identity) -> bool:
    """Return True if at least one intact batch is of a sweep, and none of another."""
    intact = [path for _, path in list_batches(folder / BATCHES) if not content_fault(path)]
    try:
        for path in intact:
            with open_verified(path, wanted.origin):
                pass
    except FileError:
        return False
    return bool(intact)


def _foreign_files(folder: Path) -> list[Path]:
    """Return files that do not come from a sweep that was ended while it made its folder."""
    batches = folder / BATCHES
    inside = sorted(batches.iterdir()) if batches.is_dir() and not batches.is_symlink() else []
    found = [
        path
        for path in sorted(folder.iterdir())
        if not (path.name == LOCK and path.is_file())
        and not (path == batches and path.is_dir())
        and not is_leftover(path, of=_OWN_FILES)
    ]
    return found + [path for path in inside if not is_leftover(path, of=BATCH_NAME)]


def read_identity(folder: Path) -> Identity:
    """Read the identity of a folder.

    Raises
    ------
    FileError
        When it holds no sweep, a damaged one, or one of another form.
    """
    path = folder / IDENTITY
    if not path.exists():
        message = f"{folder}: holds no sweep; `turnout sweep run STUDY -o {folder}` makes one"
        raise FileError(message)
    found, fault = _load_identity(path)
    if found is None:
        message = (
            f"{path}: {fault}; run `turnout sweep run STUDY -o {folder}` again with the study of "
            "this sweep, which writes it again and keeps its batches"
        )
        raise FileError(message)
    return found


def _load_identity(path: Path) -> tuple[Identity | None, str]:
    """Return the identity of a folder, and the fault that keeps it from being used.

    Raises
    ------
    FileError
        When it cannot be read, or is of another form.
    """
    known, fault = read_sealed(path, largest=LARGEST_IDENTITY)
    form = known.get("store_version")
    if type(form) is int and form != STORE_VERSION and not fault.startswith("is damaged"):
        message = (
            f"{path}: was stored in form {form}, this turnout has form {STORE_VERSION}; "
            "read it with the version that made it, or run the study again in another folder"
        )
        raise FileError(message)
    if fault:
        return None, fault
    try:
        found = from_plain(Identity, known)
        from_plain(DesignSummary, json.loads(found.design), where="design")
    except (ValueError, RecursionError) as error:
        return None, f"cannot be used ({error})"
    return found, ""


def _refuse_other(folder: Path, found: Identity, wanted: Identity) -> None:
    if found.study != wanted.study or found.count != wanted.count:
        one, other = (
            f"'{item.name}'"
            + (f" of panel {item.panel}" if found.panel != wanted.panel else "")
            + f" ({item.count} scenarios, study {item.study[:12]})"
            for item in (found, wanted)
        )
        alike = (found.name, found.panel, found.count) == (wanted.name, wanted.panel, wanted.count)
        values = ", which has other values" if alike else ""
        message = f"{folder}: holds the sweep {one}, not {other}{values}; name another folder"
        raise FileError(message)
    if (found.version, found.code) != (wanted.version, wanted.code):
        message = (
            f"{folder}: was begun with turnout {found.version} (sources {found.code}), this is "
            f"{wanted.version} (sources {wanted.code}); go on with that one, or run the study in "
            "another folder, so that no results of two versions are mixed"
        )
        raise FileError(message)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Keep others from writing to a folder; the lock ends with the process, however it ends.

    Raises
    ------
    FileError
        When another run writes to it, or it cannot be made.
    """
    make_folder(folder)
    try:
        file = (folder / LOCK).open("a+b")
    except OSError as error:
        message = f"{folder}: cannot be written to ({error.strerror}); name another folder"
        raise FileError(message) from None
    with file:
        try:
            _acquire_lock(file.fileno())
        except OSError:
            message = f"{folder}: another run writes to it now; wait for it, or end it"
            raise FileError(message) from None
        yield


def _acquire_lock(descriptor: int) -> None:
    try:
        import fcntl
    except ImportError:  # another system, with locks of its own
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def move_damaged(path: Path, folder: Path) -> Path:
    """Move a damaged file to a folder of its own in that of the sweep; return its new path.

    Raises
    ------
    FileError
        When it cannot be moved.
    """
    place = _free_path(folder, path.name)
    try:
        os.replace(path, place)
    except OSError as error:
        raise FileError(write_fault(place, error)) from None
    return place


def _free_path(folder: Path, name: str) -> Path:
    """Return a path for a damaged file that no other one has."""
    place = folder / DAMAGED
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(write_fault(place, error)) from None
    free = (place / f"{name}.{number}" for number in count(2))
    return next(path for path in chain([place / name], free) if not path.exists())


def clear_leftovers(folder: Path) -> None:
    """Remove unfinished files of writers that were ended; call this under the lock.

    Nothing else goes: only files with the name of an unfinished file of this folder are removed.
    """
    for place, own in ((folder, _OWN_FILES), (folder / BATCHES, BATCH_NAME)):
        for path in place.glob(".*"):
            if is_leftover(path, of=own):
                with suppress(OSError):
                    path.unlink()
