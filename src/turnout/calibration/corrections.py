"""What finer throws change of coarser ones: thrown once, and added to responses near by."""

from dataclasses import dataclass

from turnout.calibration.evaluate import Response, with_change


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refined:
    """One movement near the end of a fit, thrown ever more finely.

    Attributes
    ----------
    plain, halved, fine : Response
        As the scheme says; with half its step and elements half as long; and with modes to a
        higher frequency too.
    """

    plain: Response
    halved: Response
    fine: Response

    @property
    def failure(self) -> str:
        """Why it is not known what fine throws change; empty where it is."""
        return self.fine.failure or self.plain.failure

    def added(self, response: Response) -> Response:
        """Return a response near by with what fine throws change; the same where one failed."""
        if self.failure:
            return response
        return with_change(response, self.fine, self.plain)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correction:
    """One movement thrown quickly and as the scheme says, at the same values.

    Attributes
    ----------
    plain, quick : Response
        As the scheme says, and quickly.
    """

    plain: Response
    quick: Response

    def added(self, response: Response) -> Response:
        """Return a quick response near by with what plain throws change of it."""
        return with_change(response, self.plain, self.quick)
