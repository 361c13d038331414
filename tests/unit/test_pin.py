"""constraints.txt: a version, digests and a use for each package, and pip refuses other files."""

import base64
import hashlib
import re
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "constraints.txt").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SMALL = """\
# head
one==1.0 \\
    --hash=sha256:aa \\
    --hash=sha256:bb
    # for core
two==2.0 ; sys_platform == 'win32' \\
    --hash=sha256:cc
    # for daq, uq
"""


@pytest.fixture
def pin(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "bin"))
    import pin

    return pin


@pytest.fixture
def prepare(pin: ModuleType) -> ModuleType:
    import prepare

    return prepare


def test_every_version_has_digests_and_says_what_it_is_for(pin: ModuleType) -> None:
    found = list(pin.blocks(TEXT))
    assert len(found) > 100
    for block, needed_by in found:
        first, *digests = block.splitlines()
        assert re.match(r"[A-Za-z0-9._-]+==[0-9]", first), first
        assert digests, first
        assert all(re.search(r"--hash=sha256:[0-9a-f]{64}\b", line) for line in digests), first
        assert needed_by - {""}, first
    assert not re.search(r"://|--index|--find-links", TEXT), "no address is written"


def test_what_the_project_asks_for_is_pinned_where_it_is_asked_for(pin: ModuleType) -> None:
    asked = {
        "core": PROJECT["project"]["dependencies"],
        "build": PROJECT["build-system"]["requires"],
        **PROJECT["project"]["optional-dependencies"],
    }
    for group, requirements in asked.items():
        chosen = pin.selected(TEXT, ["core", group])
        names = {pin.name_of(line) for line in chosen.splitlines() if "==" in line}
        assert {pin.name_of(text) for text in requirements} <= names, group


def test_a_selection_holds_what_its_groups_need_and_no_more(pin: ModuleType) -> None:
    core = pin.selected(SMALL, ["core"])
    assert core == "one==1.0 \\\n    --hash=sha256:aa \\\n    --hash=sha256:bb\n"
    assert "two==2.0" in pin.selected(SMALL, ["uq"])
    with pytest.raises(pin.PinError, match="nothing for cad; there are core, daq, uq"):
        pin.selected(SMALL, ["core", "cad"])
    with pytest.raises(pin.PinError, match="one==1.0.* does not say what it is for"):
        pin.selected("one==1.0\n", ["core"])


def test_a_digest_is_marked_with_all_that_need_it(pin: ModuleType) -> None:
    compiled = "A_b==1 \\\n    --hash=sha256:aa\nc==2 \\\n    --hash=sha256:bb\n"
    text = "".join(pin._marked(compiled, {"core": {"a-b", "c"}, "dev": {"c"}}))
    assert [needed for _, needed in pin.blocks(text)] == [{"core"}, {"core", "dev"}]


def test_without_uv_it_says_how_to_get_it(
    pin: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(pin.shutil, "which", lambda _: None)
    monkeypatch.setattr(pin, "CONSTRAINTS", ROOT / "constraints.txt")
    assert pin.main([]) == 1
    assert "no uv on the path; install it" in capsys.readouterr().err


def wheel(folder: Path) -> str:
    """Write a wheel that pip installs without any index; return its digest."""
    record = {
        "digested.py": "VALUE = 1\n",
        "digested-1.0.dist-info/METADATA": (
            "Metadata-Version: 2.1\nName: digested\nVersion: 1.0\n"
        ),
        "digested-1.0.dist-info/WHEEL": (
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        ),
    }
    path = folder / "digested-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        lines = []
        for name, text in record.items():
            archive.writestr(name, text)
            digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=")
            lines.append(f"{name},sha256={digest.decode()},{len(text)}")
        lines.append("digested-1.0.dist-info/RECORD,,")
        archive.writestr("digested-1.0.dist-info/RECORD", "\n".join(lines))
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("right", [True, False])
def test_set_up_refuses_a_file_of_another_digest(
    prepare: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, right: bool
) -> None:
    pytest.importorskip("pip", reason="this environment has no pip")
    digest = wheel(tmp_path)
    digest = digest if right else "0" * 64
    requirements = tmp_path / "pins.txt"
    requirements.write_text(f"digested==1.0 \\\n    --hash=sha256:{digest}\n")
    monkeypatch.setattr(prepare, "PYTHON", Path(sys.executable))
    monkeypatch.setattr(prepare, "UNFINISHED", tmp_path / "unfinished")
    options = ["--no-index", "--find-links", str(tmp_path), "--target", str(tmp_path / "to")]
    options += ["--require-hashes", "--requirement", str(requirements)]
    if right:
        prepare.pip_install(*options)
        assert (tmp_path / "to" / "digested.py").is_file()
        return
    with pytest.raises(prepare.SetupError, match="installing failed"):
        prepare.pip_install(*options)
    assert not (tmp_path / "to" / "digested.py").exists()
