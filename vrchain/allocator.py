"""Memory that stays with the process: what pictures are worked on in is large, and wanted again."""

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of mallopt(3)
_LARGE = 2**31 - 1


def keep_freed_memory() -> None:
    """Ask the C library to keep freed memory instead of giving it back; for commands, not imports.

    Every scale of a panorama's SIFT is 50 MB, which the system else clears anew each time: it takes
    half as long again. Where there is no mallopt (macOS, musl) nothing is done.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)
        mallopt(_TRIM_THRESHOLD, _LARGE)
