"""Memory settings of the process that training and deciding want."""

import ctypes
import platform

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3  # glibc's malloc.h
KEEP = 1 << 30  # [bytes] of freed memory kept, and the size from which blocks are mapped apart
PAD = 1 << 26  # [bytes] asked of the system at a time


def keep_freed_memory() -> bool:
    """Let the C library keep freed memory for the next call instead of returning it.

    The model frees and asks for the same few megabytes over and over; having the system clear the
    pages each time costs a third of the time. Tells whether it is done: with glibc only.
    """
    if platform.libc_ver()[0] != "glibc":
        return False
    mallopt = ctypes.CDLL(None).mallopt
    settings = ((M_TRIM_THRESHOLD, KEEP), (M_TOP_PAD, PAD), (M_MMAP_THRESHOLD, KEEP))
    return all(mallopt(ctypes.c_int(name), ctypes.c_int(value)) == 1 for name, value in settings)
