"""A sweep run by a script of a user, who has not heard of guards around what a script does."""

import os
import subprocess
import sys
from pathlib import Path

from tests.unit.sweeps import batch_names, study_file

SCRIPT = """
from turnout.calibration.load_study import load_study
from turnout.study.sweep.run import throw_study

print("begun")
print("thrown", throw_study(load_study({study!r}), {folder!r}, workers=2).thrown)
"""


def test_workers_do_not_run_the_script_again(tmp_path: Path, worker_processes: None) -> None:
    script = tmp_path / "mine.py"
    study, folder = study_file(tmp_path, count=9), tmp_path / "out"
    script.write_text(SCRIPT.format(study=str(study), folder=str(folder)), encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, env=env, timeout=300
    )
    assert done.stderr == ""
    assert done.stdout.splitlines() == ["begun", "thrown 9"]
    assert len(batch_names(folder)) == 2
