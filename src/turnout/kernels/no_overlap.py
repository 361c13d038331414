"""Numba's compiler pipeline with the assumption that the arrays of a kernel do not overlap.

Without it a vectorised loop over several arrays begins with overlap checks, which short loops do
not repay.
"""

from numba.core.compiler import CompilerBase, DefaultPassBuilder


class WithoutOverlap(CompilerBase):
    """Compile with the flag `noalias`: no array that is written overlaps another."""

    def define_pipelines(self) -> list[object]:
        """Return the pipeline of Numba with the flag set."""
        self.state.flags.noalias = True
        pipeline: object = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        return [pipeline]
