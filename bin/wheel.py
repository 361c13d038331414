"""Build kernels ahead and put them into a wheel for this platform: python bin/wheel.py [FOLDER].

The kernels are those of some throws, for the processors of `LEVELS`; others compile at their first
use. Needs the package with the extra `dev`; the wheel is for any Python and has the tag of the
platform, such as `manylinux_2_17_x86_64`: its machine code calls functions of the C library alone.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILT = ROOT / "src" / "turnout" / "kernels" / "built"
PANEL = "uic60-760-1-15"
MACHINES = ("--set", "drive.1.machine=jea73", "--set", "drive.2.machine=jea73-drive2")
COMMANDS = (
    ("simulate", PANEL),
    ("simulate", PANEL, "--object", "13mm@sleeper6", "--mode", "waveform"),
    ("simulate", PANEL, "--mode", "quasi-static"),
    ("simulate", PANEL, *MACHINES),
)


def build() -> None:
    """Compile what the commands above use, and write it beside the sources."""
    sys.path.insert(0, str(ROOT / "src"))
    from turnout.cli.main import main
    from turnout.kernels.compiled import every_kernel
    from turnout.kernels.compiler import build_ahead
    from turnout.metric.features import load_features

    for command in COMMANDS:
        sys.argv = ["turnout", *command, "--quiet"]
        try:
            main()
        except SystemExit as ended:
            if ended.code:
                raise
    load_features()
    used = [(kernel, kinds) for kernel in every_kernel for kinds in kernel.ready]
    named = [(kernel, kinds, kernel.identity(kinds)) for kernel, kinds in used]
    parts = [(kernel.dispatcher, kinds) for kernel, kinds, _ in named]
    for file in build_ahead(parts, [str(name) for *_, name in named]):
        print(f"{file.name}: {len(parts)} kernels, {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    to = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "dist").absolute()
    options = ("--no-deps", "--no-build-isolation", "--wheel-dir", str(to))
    shutil.rmtree(BUILT, ignore_errors=True)
    try:
        with tempfile.TemporaryDirectory() as empty:
            os.chdir(empty)
            build()
            os.chdir(ROOT)
        command = [sys.executable, "-m", "pip", "wheel", "-q", *options, str(ROOT)]
        subprocess.run(command, check=True)
    finally:  # a checkout compiles for its own processor
        shutil.rmtree(BUILT, ignore_errors=True)
