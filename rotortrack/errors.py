"""Every failure and warning that rotortrack raises on purpose.

Each error is one sentence that names the file or option and says what to do; its class carries
the exit code of the command line.
"""

from __future__ import annotations

from typing import ClassVar


class RotortrackError(Exception):
    """Root of all errors raised on purpose; a bug is anything else.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rotortrack as rt
    >>> try:
    ...     rt.open_movie(Path("no-such-movie.tif"))
    ... except rt.RotortrackError as error:
    ...     print(type(error).__name__)
    MovieError
    """

    exit_code: ClassVar[int] = 1


class UsageError(RotortrackError):
    """The call itself makes no sense."""

    exit_code = 2


class InputError(RotortrackError):
    """An input file or array cannot be used."""

    exit_code = 3


class MovieError(InputError):
    """A movie file cannot be read as a stack of frames."""


class CameraError(InputError):
    """Camera maps cannot be read or do not fit the movie."""


class TableError(InputError):
    """A table lacks columns or holds values that cannot be used."""


class ImageError(InputError):
    """An image of an atomic force microscope cannot be used."""


class RegistrationError(InputError):
    """Two colours cannot be registered with these beads, or a registration does not fit.

    Parameters
    ----------
    reason
        The kind of failure in two or three words, the same for all failures of the kind.
    sentence
        What is wrong, and the remedy.
    """

    def __init__(self, reason: str, sentence: str) -> None:
        self.reason = reason
        # Both are arguments, so that the error survives the way from a worker.
        super().__init__(reason, sentence)

    def __str__(self) -> str:
        return f"{self.reason}: {self.args[1]}"


class FieldError(RotortrackError):
    """A nanopore's field cannot be solved, read or used as asked."""

    exit_code = 3


class ArchiveError(InputError):
    """A file of simulated results cannot be used."""


class RodError(RotortrackError):
    """A rod's shape, or the numbers it is made of, cannot be simulated."""

    exit_code = 3


class ConfigurationError(RotortrackError):
    """One or more options are wrong; all mistakes found are listed.

    Parameters
    ----------
    mistakes
        One sentence a mistake, each naming its option.
    """

    exit_code = 4

    def __init__(self, *mistakes: str) -> None:
        self.mistakes = mistakes
        # All mistakes are the arguments, so that the error survives the way from a worker.
        super().__init__(*mistakes)

    def __str__(self) -> str:
        return "; ".join(self.mistakes)


class NothingFoundError(RotortrackError):
    """Nothing was found and the user asked to be told so by exit code."""

    exit_code = 5


class LockedError(RotortrackError):
    """Another process writes to the folder."""

    exit_code = 6


class ResourceError(RotortrackError):
    """Disk, memory or permission does not allow the work to go on."""

    exit_code = 7


class RotortrackWarning(UserWarning):
    """Root of all warnings; each names what was assumed or is doubtful and what to do."""


class MetadataWarning(RotortrackWarning):
    """A value is missing from, or contradicts, the movie's metadata."""


class SalvageWarning(MetadataWarning):
    """A movie is cut short and the frames before the cut are used."""


class NominalCameraWarning(RotortrackWarning):
    """The camera's values are a maker's, not measured ones."""


class CalibrationWarning(RotortrackWarning):
    """The films of a calibration are doubtful, or too few to tell all that was asked."""


class GainWarning(RotortrackWarning):
    """The movie's variance-against-mean slope contradicts the given gain."""


class LineNoiseWarning(RotortrackWarning):
    """The camera adds noise that whole columns or rows share."""


class ExposureWarning(RotortrackWarning):
    """The exposure time is not given and is taken to fill the frame interval."""


class DriftWarning(RotortrackWarning):
    """The evidence for the drift estimate is weak or missing."""


class PercolationWarning(RotortrackWarning):
    """Spots are so dense that single linkage may merge separate rotors."""


class AngleWarning(RotortrackWarning):
    """Angle steps are so wide that the 180-degree rule biases them."""


class LinkWarning(RotortrackWarning):
    """Mobile particles lie so close, or move so far, that some may have been confused."""


class AliasingWarning(RotortrackWarning):
    """A simulated rotor turns too fast for its film."""


class TraceWarning(RotortrackWarning):
    """The camera's trigger in a recorded trace and the movie do not quite fit each other."""


class RegistrationWarning(RotortrackWarning):
    """Two colours are registered, but something about it is doubtful."""


class KernelCacheWarning(RotortrackWarning):
    """Compiled kernels cannot be kept on disk and are compiled at every start."""


class TableWarning(RotortrackWarning):
    """Rows or columns of an imported table were skipped or assumed."""


class ProtocolWarning(RotortrackWarning):
    """Something in another program's protocol is doubtful or has no counterpart here."""


class ContourWarning(RotortrackWarning):
    """Something of an image of rods, its scale or their stiffness, is doubtful."""
