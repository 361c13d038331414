"""Caches: what others could have put there is not read, and what is damaged is made again."""

import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from turnout.core.cache_folder import PRIVATE_VARIABLE, private_folder, safe_folder, why_unsafe
from turnout.core.stored_arrays import DamagedError, arrays_from_bytes, arrays_to_bytes
from turnout.kernels.compiled import kernel_cache_folder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")

# A kernel of its own, which is compiled in a moment.
KERNEL = """
from turnout.kernels.compiled import compiled

@compiled
def double(x):
    return 2.0 * x

def hits():
    double(1.0)
    return double.cache_hits
"""

# Puts machine code of another function where that of the kernel would lie below a folder.
PLANT = """
import os
from pathlib import Path

from turnout.kernels.arguments import NUMBER
from turnout.kernels.compiled import compiled, kernel_cache_folder

@compiled
def triple(x):
    return 3.0 * x

def plant(folder):
    import kernel
    from turnout.kernels.compiler import compiled_together

    wanted = (NUMBER,)
    place = folder / kernel.double.file_for(wanted).name
    place.parent.mkdir(parents=True, exist_ok=True)
    code = compiled_together([(triple.dispatcher, wanted)], [kernel.double.identity(wanted)])
    place.write_bytes(code.to_bytes())
    print(kernel.double(1.0))
"""


@pytest.fixture
def script_folder(tmp_path: Path) -> Path:
    """A folder for the script and its kernel, and an own one for temporary files."""
    folder = tmp_path / "script"
    (folder / "tmp").mkdir(parents=True)
    (folder / "kernel.py").write_text(KERNEL)
    return folder


def run(folder: Path, script: str, *, cache: Path) -> str:
    """Run a script with a cache folder; return what it prints."""
    left_out = ("NUMBA_CACHE_DIR", PRIVATE_VARIABLE)
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    path = folder / "script.py"
    path.write_text(script)
    done = subprocess.run(
        [sys.executable, str(path)],
        env=kept | {"TURNOUT_CACHE_DIR": str(cache), "TMPDIR": str(folder / "tmp")},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("mode", "place", "ran"),
    [
        (0o700, "kernel_cache_folder()", True),
        (0o770, "kernel_cache_folder()", False),
        (
            None,
            "Path(os.environ['TMPDIR']) / f'turnout-{os.getpid()}-{kernel_cache_folder().name}'",
            False,
        ),
    ],
    ids=["trusted", "others can write it", "predictable"],
)
def test_machine_code_is_read_from_a_trusted_folder_only(
    script_folder: Path, mode: int | None, place: str, ran: bool
) -> None:
    """Plant some in a place (an expression), and call the kernel whose it would be."""
    cache = script_folder / "cache"
    if mode is None:
        cache.write_text("in the way")
    else:
        kernels = cache / kernel_cache_folder().name
        kernels.mkdir(parents=True)
        kernels.chmod(mode)
    said = run(script_folder, f"{PLANT}\nplant({place})", cache=cache).strip()
    assert said == ("3.0" if ran else "2.0")


def test_what_was_compiled_from_other_sources_is_not_read_in_a_chosen_folder(
    script_folder: Path,
) -> None:
    chosen = script_folder / "chosen"
    found = run(
        script_folder,
        f"""
import os
os.environ["NUMBA_CACHE_DIR"] = {str(chosen)!r}
from turnout.kernels.compiled import kernel_cache_folder
print(os.environ["NUMBA_CACHE_DIR"])
print(kernel_cache_folder().name)
""",
        cache=script_folder / "cache",
    )
    folder, name = found.splitlines()
    assert Path(folder) == chosen / name


WORKER = """
import os, sys, stat
from pathlib import Path

if __name__ == "__main__":
    import kernel
    from turnout.core.cache_folder import why_private
    from turnout.core.processes import worker_processes
    kernel.double(1.0)
    with worker_processes(1) as workers:
        print(workers.submit(kernel.hits).result())
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    print(folder)
    print(oct(stat.S_IMODE(folder.parent.stat().st_mode)), folder.parent.stat().st_uid)
    print(why_private())
"""


def test_workers_share_the_private_folder_which_ends_with_the_run(
    script_folder: Path, worker_processes: None
) -> None:
    blocked = script_folder / "file"
    blocked.write_text("in the way")
    hits, folder, owner, reason = run(script_folder, WORKER, cache=blocked).splitlines()
    assert hits == "1"
    assert Path(folder).parent.parent == script_folder / "tmp"
    assert not Path(folder).exists()
    assert list((script_folder / "tmp").iterdir()) == []
    assert owner == f"0o700 {os.geteuid()}"
    assert reason.startswith(f"{blocked}/kernels-")
    assert reason.endswith("is not writable")


def test_a_folder_of_another_user_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert why_unsafe(tmp_path) == ""
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    assert why_unsafe(tmp_path) == f"{tmp_path} belongs to another user"


def test_a_folder_that_others_can_replace_is_not_used(tmp_path: Path) -> None:
    folder = tmp_path / "open" / "own"
    folder.mkdir(parents=True)
    for mode in (0o777, 0o1777, 0o770):
        folder.chmod(mode)
        assert why_unsafe(folder) == f"{folder} can be written by other users", oct(mode)
    folder.chmod(0o700)
    (tmp_path / "open").chmod(0o777)
    assert "which can be written by other users" in why_unsafe(folder)
    (tmp_path / "open").chmod(0o1777)  # there only the owner moves what is his
    assert why_unsafe(folder) == ""


def test_a_link_to_a_folder_that_others_can_write_is_not_used(tmp_path: Path) -> None:
    others = tmp_path / "others"
    others.mkdir()
    others.chmod(0o777)
    (tmp_path / "cache").symlink_to(others)
    assert safe_folder(tmp_path / "cache") != others
    assert why_unsafe(tmp_path / "cache") == f"{tmp_path / 'cache'} can be written by other users"


def test_links_and_open_files_in_a_folder_are_not_used(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    inside = tmp_path / "kernels" / "index"
    inside.parent.mkdir()
    inside.write_text("")
    assert why_unsafe(tmp_path) == ""
    inside.chmod(0o666)
    assert why_unsafe(tmp_path) == f"{inside} can be written by other users"
    tmp_path.chmod(0o700)  # no one else gets to the file
    assert why_unsafe(tmp_path) == ""
    (tmp_path / "link").symlink_to("/etc")
    assert why_unsafe(tmp_path) == f"{tmp_path / 'link'} is a link"


def test_what_is_made_is_for_the_user_alone(tmp_path: Path) -> None:
    made = safe_folder(tmp_path / "a" / "b")
    assert made == tmp_path / "a" / "b"
    for folder in (made, made.parent):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_private_folder_that_others_opened_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PRIVATE_VARIABLE, str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert private_folder() == tmp_path
    tmp_path.chmod(0o1777)
    fresh = private_folder()
    assert fresh is not None
    assert fresh.parent == tmp_path
    assert private_folder() == fresh


def test_a_flipped_bit_in_any_byte_of_kept_arrays_is_seen() -> None:
    arrays = {"a": np.arange(7.0), "b": np.array(["x", "yz"]), "c": np.zeros((2, 0))}
    content = arrays_to_bytes(arrays, "key")
    for name, values in arrays_from_bytes(content, "key").items():
        np.testing.assert_array_equal(values, arrays[name])
    seen = 0
    for place in range(len(content)):
        damaged = bytearray(content)
        damaged[place] ^= 1 << place % 8
        try:
            back = arrays_from_bytes(bytes(damaged), "key")
        except DamagedError:
            seen += 1
        else:  # a flag or a date of the archive, which says nothing about the arrays
            assert list(back) == list(arrays)
            for name, values in back.items():
                np.testing.assert_array_equal(values, arrays[name])
    assert seen > 0.5 * len(content)


def test_kept_arrays_of_another_purpose_or_size_are_refused() -> None:
    content = arrays_to_bytes({"a": np.zeros(10)}, "key")
    with pytest.raises(DamagedError):
        arrays_from_bytes(content, "other")
    with pytest.raises(DamagedError):
        arrays_from_bytes(content[:-30], "key")
    with pytest.raises(DamagedError, match="is damaged"):
        # A size of 80 TB, in a file of a few hundred bytes.
        arrays_from_bytes(content.replace(b"(10,), }           ", b"(10000000000000,), }"), "key")
    with pytest.raises(TypeError, match="pickled"):
        arrays_to_bytes({"a": np.array([object()])}, "key")
