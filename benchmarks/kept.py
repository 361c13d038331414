"""Results that are kept, so that interrupted long work resumes."""

import json
from pathlib import Path


def keep(path: Path, found: object) -> None:
    """Keep a measurement; an interruption leaves nothing half-written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".part")
    draft.write_text(json.dumps(found), encoding="utf-8")
    draft.replace(path)
