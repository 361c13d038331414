"""Arrays as the content of a file."""

import zipfile
from typing import Any

import numpy as np
import pytest

from turnout.core.stored_arrays import arrays_to_bytes


# The archive that was left open says so once more when it is collected.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_within_an_array_is_that_and_no_other_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Interrupted:
        def __init__(self, *_: Any, **__: Any) -> None:
            raise KeyboardInterrupt

    # Where a member is open and none can be written, closing the archive fails.
    monkeypatch.setattr(zipfile, "_ZipWriteFile", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        arrays_to_bytes({"a": np.arange(3.0)}, "example")
