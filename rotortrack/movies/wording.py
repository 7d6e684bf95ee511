"""How failures of movie files are worded."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from rotortrack.errors import MovieError, ResourceError, RotortrackError, RotortrackWarning
from rotortrack.movies.metadata import clean

COPY_AGAIN = "copy it again from where it was recorded"


@contextlib.contextmanager
def one_sentence(path: Path, action: str, remedy: str = COPY_AGAIN) -> Iterator[None]:
    """Turn whatever a damaged file makes tifffile, a codec or the system raise into one error.

    Parameters
    ----------
    path
        The file that is named.
    action
        What is being done to it, such as ``opened``.
    remedy
        What to do about damage.

    Raises
    ------
    MovieError
        The file cannot be opened or read, is damaged, or needs a codec that is not installed.
    ResourceError
        The system has no more files or memory to give.
    MemoryError
        The memory does not suffice to read frames. While a file is opened, it is the absurd size
        of something damaged and a MovieError.
    """
    try:
        yield
    except (RotortrackError, RotortrackWarning):
        raise
    except OSError as error:
        reason = error.strerror or type(error).__name__
        if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOMEM):
            raise ResourceError(
                f"{path} cannot be {action} ({reason}): close other programs, allow more open "
                "files (`ulimit -n 4096`), or use fewer --workers"
            ) from error
        raise MovieError(
            f"{path} cannot be {action} ({reason}): check that the file is there and readable"
        ) from error
    except Exception as error:
        if (isinstance(error, MemoryError) and action != "opened") or _is_our_bug(error):
            raise
        text = clean(str(error)) or type(error).__name__
        if isinstance(error, ImportError) or "imagecodecs" in text:
            raise MovieError(
                f"{path} is compressed in a way that needs more codecs: install them with "
                "pip install 'rotortrack[codecs]'"
            ) from error
        raise MovieError(f"{path} is damaged and cannot be {action} ({text}): {remedy}") from error


def _is_our_bug(error: Exception) -> bool:
    """Whether it is a slip in our own code, which no file can cause; tifffile has such, too."""
    if not isinstance(error, AssertionError | AttributeError | NameError | NotImplementedError):
        return False
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    package = Path(__file__).parents[1]
    return trace is not None and package in Path(trace.tb_frame.f_code.co_filename).parents
