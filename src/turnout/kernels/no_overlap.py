"""Numba's own way of compiling, told that the arrays of a kernel do not overlap.

Loops over many arrays otherwise begin by comparing the places of all of them, and short ones are
then not worth the wider instructions of the processor.
"""

from numba.core.compiler import CompilerBase, DefaultPassBuilder


class WithoutOverlap(CompilerBase):
    """Compiles what takes arrays of which none that is written overlaps another."""

    def define_pipelines(self) -> list[object]:
        """Return the one way."""
        self.state.flags.noalias = True
        way: object = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        return [way]
