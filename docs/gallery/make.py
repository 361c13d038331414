"""Run every script of the gallery and keep its picture: python docs/gallery/make.py [NAME ...]."""

import os
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURES = HERE.parent / "figures" / "gallery"


def scripts() -> list[Path]:
    """Return the scripts of the gallery."""
    return sorted(path for path in HERE.glob("*.py") if path.name != "make.py")


def drawn(script: Path, folder: Path) -> Path:
    """Run a script in a folder; return the picture that it must have written there."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        runpy.run_path(str(script), run_name="__main__")
    finally:
        os.chdir(before)
    picture = folder / f"{script.stem}.png"
    if not picture.is_file():
        message = f"{script.name} wrote no {picture.name}"
        raise FileNotFoundError(message)
    return picture


def main(names: list[str]) -> None:
    """Make the pictures of some scripts, or of all."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for script in scripts():
        if not names or script.stem in names:
            with tempfile.TemporaryDirectory() as folder:
                shutil.copy(drawn(script, Path(folder)), PICTURES)
            print(PICTURES / f"{script.stem}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
