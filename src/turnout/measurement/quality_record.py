"""What a fault of a recorded throw is, and from what size on something is one."""

from dataclasses import dataclass

KINDS = (
    "unit",
    "clipping",
    "drop-out",
    "missing samples",
    "dead channel",
    "swapped channels",
    "reversed polarity",
    "direction",
    "sampling rate",
    "mains hum",
    "truncated",
    "spikes",
    "drift",
    "zero offset",
    "quantisation",
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong with a throw.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    channel : str
        Such as "drive_force 2"; empty where it concerns the whole throw.
    text : str
        What was found, with the figure and its limit.
    excludes : bool
        Whether the throw must not be used.
    """

    kind: str
    channel: str
    text: str
    excludes: bool = True

    def __str__(self) -> str:
        """Give the line that a user reads."""
        where = f" of {self.channel}" if self.channel else ""
        return f"{self.kind}{where}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """From what size on something is a fault.

    Attributes
    ----------
    longest_hole : float
        Missing samples in a row [s].
    missing_share : float
        Missing samples of all.
    least_run : int
        Equal samples in a row, in a channel that has noise.
    clipped_share : float
        Samples at the very largest or least value.
    least_response : mapping of str to float
        What a channel must change by in a throw, else it is dead [N, A].
    most_hum : mapping of str to float
        Amplitude of a line of the mains [N, A].
    mains : tuple of float
        Frequencies of lines that mains put into cables [Hz].
    rate_share : float
        Departure of a stated sampling rate.
    pace_share : float
        Departure of the pace of a throw from that of the campaign; voltage alone makes some.
    least_rest : float
        Rest before the onset and after the end [s].
    polarity_force : float
        Change of a rod force against the direction [N].
    swap_gain : float
        How many times better channels must fit when they are swapped.
    most_spike : mapping of str to float
        Height of a single sample above its neighbours [N, A].
    most_drift : float
        Change of the zero of a force in the time that is kept of a throw [N].
    most_offset : mapping of str to float
        Departure of the zero: of a rod force from the rest of the campaign, of a current and of
        the load cell from nothing [N, A].
    most_step : mapping of str to float
        Least difference of two samples [N, A].
    """

    longest_hole: float = 0.01
    missing_share: float = 0.005
    least_run: int = 6
    clipped_share: float = 0.005
    least_response: tuple[tuple[str, float], ...] = (
        ("drive_force", 60.0),
        ("drive_current", 0.2),
        ("object_force", 40.0),
    )
    most_hum: tuple[tuple[str, float], ...] = (
        ("drive_force", 60.0),
        ("drive_current", 0.1),
        ("object_force", 60.0),
    )
    mains: tuple[float, ...] = (50.0 / 3.0, 50.0, 60.0, 100.0, 150.0)
    rate_share: float = 0.002
    pace_share: float = 0.12
    least_rest: float = 0.15
    polarity_force: float = 100.0
    swap_gain: float = 2.0
    most_spike: tuple[tuple[str, float], ...] = (
        ("drive_force", 500.0),
        ("drive_current", 2.0),
        ("object_force", 500.0),
    )
    most_drift: float = 200.0
    most_offset: tuple[tuple[str, float], ...] = (
        ("drive_force", 750.0),
        ("drive_current", 0.15),
        ("object_force", 200.0),
    )
    most_step: tuple[tuple[str, float], ...] = (
        ("drive_force", 50.0),
        ("drive_current", 0.05),
        ("object_force", 50.0),
    )
