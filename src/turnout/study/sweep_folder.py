"""The folder of a sweep: whose it is, who writes to it, and what is in it."""

import json
import pickle
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from turnout.errors import FileError
from turnout.files.atomic import write_atomic
from turnout.files.provenance import version
from turnout.study.study import Study
from turnout.study.sweep_batch import batches_of

STORE_VERSION = 1
IDENTITY, BATCHES, STUDY, LOCK, JOURNAL = "sweep.json", "batches", "study.pickle", ".lock", "log"
# All that makes or changes a stored number.
_SOURCES = (
    *("panel", "section", "beam", "reduction", "law", "mechanism", "integrate", "response"),
    *("metric", "study", "schema"),
)


@dataclass(frozen=True, slots=True)
class Identity:
    """What a folder says of itself.

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


def identity_of(study: Study) -> Identity:
    """Return what the folder of a study must say."""
    return Identity(
        store_version=STORE_VERSION,
        study=study.digest,
        name=study.name,
        description=study.description,
        panel=study.panel.name,
        version=version(),
        code=code_digest(),
        seed=study.seed,
        count=study.count,
        batches=len(batches_of(study)),
        interval=study.output.interval,
        scheme=study.scheme.describe(),
        design=json.dumps(study.design.described()),
    )


@cache
def code_digest() -> str:
    """Return a digest of the sources that results depend on."""
    found = sha256()
    root = Path(__file__).parents[1]
    for package in _SOURCES:
        for source in sorted((root / package).rglob("*.py")):
            found.update(source.name.encode())
            found.update(source.read_bytes())
    return found.hexdigest()[:16]


def claim_folder(folder: Path, study: Study) -> bool:
    """Make a folder that of a study, or find that it is; call this under its lock.

    Returns
    -------
    bool
        Whether it was begun before.

    Raises
    ------
    FileError
        When it is that of another study or version, or holds something else; it is not touched.
    """
    wanted = identity_of(study)
    begun = (folder / IDENTITY).exists()
    if begun:
        _refuse_other(folder, read_identity(folder), wanted)
    try:
        (folder / BATCHES).mkdir(exist_ok=True)
    except OSError as error:
        message = f"{folder / BATCHES}: cannot be made ({error.strerror}); name another folder"
        raise FileError(message) from None
    if not begun:
        write_atomic(folder / IDENTITY, json.dumps(asdict(wanted), indent=1))
    write_atomic(folder / STUDY, pickle.dumps(study))
    return begun


def check_folder(folder: Path, study: Study) -> None:
    """Refuse a folder that is not empty and not that of this study, before anything is made.

    Raises
    ------
    FileError
        Naming what is there and the remedy.
    """
    if folder.exists() and not folder.is_dir():
        message = f"{folder}: is a file; name a folder"
        raise FileError(message)
    if (folder / IDENTITY).exists():
        _refuse_other(folder, read_identity(folder), identity_of(study))
    elif folder.is_dir() and _strangers(folder):
        message = f"{folder}: is not empty and holds no sweep; name another folder"
        raise FileError(message)


def _strangers(folder: Path) -> list[Path]:
    """Return what does not come from a sweep that was ended while it made its folder."""
    ours = (LOCK, BATCHES)
    return [p for p in folder.iterdir() if p.name not in ours and not p.name.startswith(".sweep.")]


def read_identity(folder: Path) -> Identity:
    """Read what a folder says of itself.

    Raises
    ------
    FileError
        When it holds no sweep, or one of another form.
    """
    path = folder / IDENTITY
    try:
        known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        found = known["store_version"]
        if found == STORE_VERSION:
            return Identity(**known)
    except FileNotFoundError:
        message = f"{folder}: holds no sweep; `turnout sweep run STUDY -o {folder}` makes one"
        raise FileError(message) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        message = f"{path}: cannot be used ({error}); take another folder and run the study again"
        raise FileError(message) from None
    message = (
        f"{folder}: was stored in form {found}, this turnout has form {STORE_VERSION}; "
        "read it with the version that made it, or run the study again in another folder"
    )
    raise FileError(message)


def _refuse_other(folder: Path, found: Identity, wanted: Identity) -> None:
    if found.study != wanted.study or found.count != wanted.count:
        message = (
            f"{folder}: holds the sweep '{found.name}' ({found.count} scenarios, study "
            f"{found.study[:12]}), not '{wanted.name}' ({wanted.count} scenarios, study "
            f"{wanted.study[:12]}); name another folder"
        )
        raise FileError(message)
    if (found.version, found.code) != (wanted.version, wanted.code):
        message = (
            f"{folder}: was begun with turnout {found.version} (sources {found.code}), this is "
            f"{wanted.version} (sources {wanted.code}); go on with that one, or run the study in "
            "another folder, so that no results of two versions are mixed"
        )
        raise FileError(message)


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep others from writing to a folder; the lock ends with the process, however it ends.

    Raises
    ------
    FileError
        When another run writes to it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a+b")
    except OSError as error:
        message = f"{folder}: cannot be made or written ({error.strerror}); name another folder"
        raise FileError(message) from None
    with file:
        try:
            _take(file.fileno())
        except OSError:
            message = f"{folder}: another run writes to it now; wait for it, or end it"
            raise FileError(message) from None
        yield


def _take(descriptor: int) -> None:
    try:
        import fcntl
    except ImportError:  # another system, with locks of its own
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@lru_cache(maxsize=2)
def kept_study(folder: Path, digest: str) -> Study:
    """Return the study of a folder as its run has left it for the processes that throw it.

    Raises
    ------
    FileError
        When it is not there, or another one than asked for.
    """
    try:
        study = pickle.loads((folder / STUDY).read_bytes())
    except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError) as error:
        message = f"{folder / STUDY}: cannot be read by this process ({error}); is it shared?"
        raise FileError(message) from None
    if not isinstance(study, Study) or study.digest != digest:
        message = f"{folder / STUDY}: is not the study that is being run"
        raise FileError(message)
    return study


def clear_leftovers(folder: Path) -> None:
    """Remove what writers that were ended left unfinished; call this under the lock."""
    for place in (folder, folder / BATCHES):
        for path in place.glob(".*.*"):
            if path.name.startswith(".lock"):
                continue
            with suppress(OSError):
                path.unlink()
