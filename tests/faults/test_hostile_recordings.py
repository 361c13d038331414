"""Small files that ask for much: read or refused within 1 GB and 10 s, with one message."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.faults.hostile_recordings import HOSTILE

MOST_MEMORY, MOST_SECONDS = 1_000_000_000, 10.0
# Its own limit only keeps a program that fails this test from taking the machine's memory.
READ = """
import json, resource, sys, time
resource.setrlimit(resource.RLIMIT_DATA, (4_000_000_000, 4_000_000_000))
import turnout.measurement.formats.files
from turnout.errors import FileError
began, said = time.process_time(), ""
try:
    turnout.measurement.formats.files.read_recording(sys.argv[1])
except FileError as error:
    said = str(error)
for item in turnout.measurement.formats.isolated._kept:
    item.close()
used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps({
    "said": said,
    "memory": [1024 * item.ru_maxrss for item in used],
    "seconds": sum(item.ru_utime + item.ru_stime for item in used),
}))
"""


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_recording_takes_little(tmp_path: Path, name: str) -> None:
    """Time is that of the processors, as a machine may be busy otherwise."""
    suffix, write = HOSTILE[name]
    path = tmp_path / f"throw{suffix}"
    write(path)
    run = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stderr == ""
    found = json.loads(run.stdout)
    assert len(found["said"].splitlines()) <= 1
    assert len(found["said"]) < 1000
    assert max(found["memory"]) < MOST_MEMORY, found
    assert found["seconds"] < MOST_SECONDS, found
