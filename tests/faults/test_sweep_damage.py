"""Damage to the folder of a sweep is seen, named and mended, and nothing of the user's is lost."""

import hashlib
import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.unit.sweeps import batch_names, here, small_study, study_file

from turnout.cli.main import main
from turnout.core.errors import FileError
from turnout.core.json_files import sealed_json
from turnout.study.study import Study
from turnout.study.sweep import verify
from turnout.study.sweep.batch import write_batch
from turnout.study.sweep.export import sweep_table
from turnout.study.sweep.folder import BATCHES, DAMAGED, IDENTITY
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_study
from turnout.study.sweep.stored_study import STUDY, load_stored_study
from turnout.study.sweep.verify import STABLE_AGE

COUNT, FLIPS = 12, 60


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return small_study(tmp_path_factory.mktemp("study"), count=COUNT)


@pytest.fixture(scope="module")
def made(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "sweep"
    throw_study(study, folder, pool=here)
    assert len(batch_names(folder)) == 2
    return folder


@pytest.fixture
def swept(made: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(made, tmp_path / "sweep"))


def command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object
) -> tuple[int, str]:
    """Run the program in this process; return its exit code and all that it said."""
    monkeypatch.setattr(sys, "argv", ["turnout", *map(str, words)])
    with pytest.raises(SystemExit) as caught:
        main()
    said = capsys.readouterr()
    return int(caught.value.code or 0), said.out + said.err


def flip(path: Path, bit: int) -> None:
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


def test_every_flipped_bit_is_harmless_or_named(made: Path, study: Study, swept: Path) -> None:
    """In batches, in what the folder says of itself, and in the study that workers read."""
    known = open_batches(made).load()
    paths = [swept / IDENTITY, swept / STUDY, *(swept / BATCHES).glob("*.nc")]
    rng = np.random.default_rng(17)
    reported = 0
    for number in range(FLIPS):
        path = paths[number % len(paths)]
        content = path.read_bytes()
        flip(path, int(rng.integers(8 * len(content))))
        load_stored_study.cache_clear()
        said = ""
        try:
            xr.testing.assert_identical(open_batches(swept).load(), known)
            xr.testing.assert_identical(read_labels(swept), known.drop_dims("time"))
            assert load_stored_study(swept, study.digest).scenario(5) == study.scenario(5)
            assert load_stored_study(swept, study.digest).panel.hash == study.panel.hash
        except FileError as error:
            said = str(error)
        if said:
            reported += 1
            assert str(path) in said
            assert "sweep run" in said
        path.write_bytes(content)
    assert reported > FLIPS * 0.9
    load_stored_study.cache_clear()


@pytest.mark.parametrize("lazily", [False, True])
def test_damage_after_a_first_look_is_seen(lazily: bool, swept: Path, made: Path) -> None:
    """What was verified once is verified again when its time stamps are others."""
    dataset = open_batches(swept)
    dataset["drive_force"].load()
    path = max((swept / BATCHES).glob("*.nc"))
    flip(path, 80_000)
    look = dataset["drive_gap"].load if lazily else lambda: read_labels(swept)
    with pytest.raises(FileError, match=f"{path.name}: is damaged"):
        look()


@pytest.mark.parametrize("finished", [True, False])
def test_a_batch_is_digested_once_while_it_stays_as_it_is(
    finished: bool, swept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that was just changed may change again with the same time stamp."""
    read: list[str] = []
    kept = hashlib.file_digest

    def digest(file: Any, name: str) -> Any:
        read.append(Path(file.name).name)
        return kept(file, name)

    changed = max(path.stat().st_ctime_ns for path in (swept / BATCHES).iterdir())
    monkeypatch.setattr(hashlib, "file_digest", digest)
    now = changed + (STABLE_AGE + 1 if finished else 0)
    monkeypatch.setattr(verify, "time", SimpleNamespace(time_ns=lambda: now))
    read_labels(swept)
    assert (sorted(read) == batch_names(swept)) == finished
    before = len(read)
    open_batches(swept).load()
    assert (len(read) == before) == finished


@pytest.mark.parametrize(
    "words",
    [
        ("sweep", "export", "{folder}", "--csv", "{other}/table.csv"),
        ("sweep", "map", "{folder}", "--x", "chair.friction_coefficient"),
        ("sweep", "effects", "{folder}"),
        ("report", "{folder}", "-o", "{other}/report.html"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_each_command_names_a_damaged_batch_and_how_to_mend_it(
    words: tuple[str, ...],
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = min((swept / BATCHES).glob("*.nc"))
    flip(path, 90_001)
    code, said = command(
        capsys, monkeypatch, *(word.format(folder=swept, other=tmp_path) for word in words)
    )
    assert code == 2, said
    assert f"{path}: is damaged" in said
    assert f"`turnout sweep run STUDY -o {swept}`" in said
    assert "Traceback" not in said
    assert not list(tmp_path.glob("*.csv")) + list(tmp_path.glob("*.html"))


def test_the_same_run_mends_damage_and_keeps_what_was_damaged(
    made: Path,
    swept: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = study_file(tmp_path, count=COUNT)
    names = batch_names(swept)
    good = (swept / BATCHES / names[0]).stat().st_mtime_ns
    for _ in range(2):
        flip(swept / BATCHES / names[1], 4242)
        flip(swept / IDENTITY, 999)
        flip(swept / STUDY, 9999)
        code, said = command(
            capsys, monkeypatch, "sweep", "run", file, "-o", swept, "--workers", "1"
        )
        assert code == 0, said
        assert names[1] in said
        assert "4 complete" in said, "only what was damaged is thrown"
    assert batch_names(swept) == batch_names(made)
    assert (swept / IDENTITY).read_bytes() == (made / IDENTITY).read_bytes()
    assert (swept / BATCHES / names[0]).stat().st_mtime_ns == good
    kept = sorted(path.name for path in (swept / DAMAGED).iterdir())
    assert kept == sorted([names[1], f"{names[1]}.2", IDENTITY, f"{IDENTITY}.2"])
    xr.testing.assert_identical(open_batches(swept).load(), open_batches(made).load())


def test_a_batch_of_another_seed_is_refused(swept: Path, study: Study, tmp_path: Path) -> None:
    other = replace(study, seed=4, design=replace(study.design, seed=4))
    throw_study(other, tmp_path / "other", pool=here)
    stranger = min((tmp_path / "other" / BATCHES).glob("*.nc"))
    mine = min((swept / BATCHES).glob("*.nc"))
    mine.unlink()
    copied = Path(shutil.copy(stranger, mine.parent))
    for look in (open_batches, read_labels, sweep_table):
        with pytest.raises(FileError, match=f"{copied.name}: comes from another study .*move it"):
            look(swept)
    with pytest.raises(FileError, match="comes from another study"):
        throw_study(study, swept, pool=here)
    assert copied.exists()
    copied.unlink()
    assert throw_study(study, swept, pool=here).thrown == 8


def test_a_batch_in_the_place_of_another_is_refused(swept: Path, study: Study) -> None:
    """Its scenarios would be there twice, and others not at all."""
    first, second = sorted((swept / BATCHES).glob("*.nc"))
    second.unlink()
    copied = Path(shutil.copy(first, first.with_name(first.name.replace("000000", "000001"))))
    for look in (lambda: open_batches(swept), lambda: throw_study(study, swept, pool=here)):
        with pytest.raises(FileError, match="is batch 0, not 1"):
            look()
    assert copied.exists()


def test_a_batch_without_an_origin_is_refused(swept: Path, study: Study) -> None:
    import io

    import h5py

    path = min((swept / BATCHES).glob("*.nc"))
    content = io.BytesIO(path.read_bytes())
    with h5py.File(content, "a") as file:
        del file.attrs["origin"]
    path.unlink()
    bare = write_batch(swept / BATCHES, 0, content.getvalue())
    with pytest.raises(FileError, match=f"{bare.name}: does not say which study"):
        open_batches(swept)


def unsealed(folder: Path, name: str) -> dict[str, Any]:
    known: dict[str, Any] = json.loads((folder / name).read_text(encoding="utf-8"))
    known.pop("checksum")
    return known


def with_design(**changes: object) -> Callable[[dict[str, Any]], dict[str, Any]]:
    def changed(known: dict[str, Any]) -> dict[str, Any]:
        return known | {"design": json.dumps(json.loads(known["design"]) | changes)}

    return changed


WRONG: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "count a text": (lambda k: k | {"count": "12"}, 'count = "12": must be an integer'),
    "count true": (lambda k: k | {"count": True}, "count = true: must be an integer"),
    "name a list": (lambda k: k | {"name": ["a"]}, "name = .*: must be a text"),
    "interval nothing": (lambda k: k | {"interval": None}, "interval = .*: must be a number"),
    "key missing": (lambda k: {n: v for n, v in k.items() if n != "seed"}, "seed is missing"),
    "key unknown": (lambda k: k | {"sed": 1}, "sed is not known"),
    "design no JSON": (lambda k: k | {"design": "{"}, "Expecting property"),
    "design a list": (lambda k: k | {"design": "[]"}, "must be a table"),
    "design of wrong type": (with_design(drawn=3), "design.drawn = 3: must be a list"),
    "design in a list": (with_design(axes=[["a"], [1]]), "design.axes 2 1 = 1: must be a text"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_types_and_keys_are_reported(name: str, swept: Path) -> None:
    change, said = WRONG[name]
    (swept / IDENTITY).write_text(sealed_json(change(unsealed(swept, IDENTITY))))
    with pytest.raises(FileError, match=f"sweep.json: cannot be used.*{said}"):
        open_batches(swept)


TEXTS = {
    "empty": b"",
    "half": b'{"store_version": 2, "study',
    "a list": b"[1, 2]",
    "a number": b"17",
    "no UTF-8": b'{"a": "\xff"}',
    "not finite": b'{"store_version": 2, "interval": NaN, "checksum": "a"}',
    "deep": b"[" * 100_000,
    "checksum missing": b'{"store_version": 2}',
    "form of another kind": b'{"store_version": [2], "checksum": 3}',
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("file", [IDENTITY, STUDY])
def test_files_that_are_none_are_reported(file: str, name: str, swept: Path, study: Study) -> None:
    (swept / file).write_bytes(TEXTS[name])
    load_stored_study.cache_clear()
    with pytest.raises(FileError, match=f"{file}: .*turnout sweep run"):
        open_batches(swept) if file == IDENTITY else load_stored_study(swept, study.digest)


@pytest.mark.parametrize(
    "change",
    [
        lambda k: k | {"seed": "3"},
        lambda k: k | {"panel": []},
        lambda k: k | {"panel": k["panel"] | {"tree": {}}},
        lambda k: k | {"panel": k["panel"] | {"matrices": {"a": {"digest": ""}}}},
        lambda k: k | {"scheme": k["scheme"] | {"step": -1.0}},
        lambda k: k | {"design": k["design"] | {"copula": [[1.0], [2.0, 3.0]]}},
        lambda k: k | {"seed": 4},
    ],
)
def test_a_study_that_is_none_is_reported(
    change: Callable[[dict[str, Any]], dict[str, Any]], swept: Path, study: Study
) -> None:
    (swept / STUDY).write_text(sealed_json(change(unsealed(swept, STUDY))))
    load_stored_study.cache_clear()
    with pytest.raises(FileError, match=r"study.json: .*turnout sweep run"):
        load_stored_study(swept, study.digest)


def test_hidden_and_other_files_survive(swept: Path, study: Study) -> None:
    """Only names that an unfinished file of the folder has are taken for one."""
    others = [
        *(".env.local", ".a.b", ".sweep.json", ".sweep.old.json", "notes.txt", ".lock.local"),
        *(".sweep.abcdefgh.toml", ".study.abcdefghi.json", ".README.12345678.html"),
        *(f"{BATCHES}/.env.local", f"{BATCHES}/.000001-half.nc", f"{BATCHES}/mine.nc"),
    ]
    for name in others:
        (swept / name).write_text(name)
    leftovers = [".sweep.abcdefgh.json", ".study.a_cd3fgh.json", ".README.12345678.md"]
    leftovers.append(f"{BATCHES}/.{batch_names(swept)[0].removesuffix('.nc')}.zzzzzzzz.nc")
    for name in leftovers:
        (swept / name).write_text(name)
    min((swept / BATCHES).glob("[0-9]*.nc")).unlink()
    throw_study(study, swept, pool=here)
    assert [name for name in others if (swept / name).read_text() != name] == []
    assert [name for name in leftovers if (swept / name).exists()] == []


@pytest.mark.parametrize(
    "name", [".env.local", ".sweep.mine", "batches/mine.nc", "batches/.hidden", ".lock/a"]
)
def test_a_folder_with_other_files_is_refused(name: str, study: Study, tmp_path: Path) -> None:
    path = tmp_path / "full" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(FileError, match="is not empty and holds no sweep"):
        throw_study(study, tmp_path / "full", pool=here)
    assert [p for p in (tmp_path / "full").rglob("*") if p.is_file()] == [path]
    assert path.read_text() == "mine"
    with pytest.raises(FileError, match="holds no sweep"):
        open_batches(tmp_path / "full")


def test_a_folder_of_the_form_with_a_pickle_is_refused(study: Study, swept: Path) -> None:
    """Nothing of it is read but the form that it says to have."""
    old = unsealed(swept, IDENTITY) | {"store_version": 1}
    (swept / IDENTITY).write_text(json.dumps(old))
    (swept / STUDY).unlink()
    (swept / "study.pickle").write_bytes(b"cos\nsystem\n(S'touch planted'\ntR.")
    before = {path: path.read_bytes() for path in swept.rglob("*") if path.is_file()}
    for look in (lambda: open_batches(swept), lambda: throw_study(study, swept, pool=here)):
        with pytest.raises(FileError, match="stored in form 1.*run the study again in another"):
            look()
    assert {path: path.read_bytes() for path in swept.rglob("*") if path.is_file()} == before


def test_a_study_made_in_python_is_stored_exactly(study: Study, tmp_path: Path) -> None:
    from turnout.study.design import Drawn
    from turnout.study.distribution import Choice

    law = Choice(values=(0.1, 0.2 + 0.1, 1 / 3), weights=(1, 2.0, np.float64(3)))
    name = study.design.drawn[0].name
    panel = study.panel.with_overrides(
        {"drive.1.stiffness": np.float64(1e6) / 3, "object.stone": {"size": 0.013, "at": "drive 1"}}
    )
    own = replace(
        study,
        panel=panel,
        design=replace(study.design, drawn=(Drawn(name=name, law=law),)),
        description='quote " and newline \n and 60E1 \u00e4',
    )
    throw_study(own, tmp_path / "s", pool=here)
    kept = load_stored_study((tmp_path / "s").absolute(), own.digest)
    assert kept.digest != study.digest
    assert kept.panel.hash == panel.hash
    assert dict(kept.panel.overrides) == dict(panel.overrides)
    assert dict(kept.panel.origins) == dict(panel.origins)
    assert kept.description == own.description
    assert list(kept.scenarios()) == list(own.scenarios())
    assert kept.panel.with_overrides({"drive.1.stiffness": 7e5}).drive["1"].stiffness == 7e5


def test_no_file_is_unpickled(pytestconfig: pytest.Config) -> None:
    """Nor is anything that the studio's processes hand each other."""
    sources = pytestconfig.rootpath / "src" / "turnout"
    texts = {
        path.relative_to(sources).as_posix(): path.read_text(encoding="utf-8")
        for path in sources.rglob("*.py")
    }
    banned = (
        "import pickle",
        "pickle.load",
        "allow_pickle=True",
        "import marshal",
        "import shelve",
    )
    found = [name for name, text in texts.items() if any(word in text for word in banned)]
    assert not found
