"""The shared library: how its functions are called, and what their statuses become."""

import os
import threading
import time
from pathlib import Path
from typing import Any, Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _errors
from ._binding import ffi as _ffi

ffi: Any = _ffi
_HERE = Path(__file__).parent


def _open() -> Any:
    beside = _HERE / "libridgecast.so.1"
    name = str(beside) if beside.exists() else "libridgecast.so.1"
    try:
        return ffi.dlopen(name)
    except OSError as e:
        raise ImportError(f"{e}; on Debian 12: apt install libdraco7 libprotobuf32 libssl3 libtiff6 libpng16-16") from None


lib: Any = _open()
version: str = ffi.string(lib.rc_version()).decode()

_ERRORS = {lib.RC_INVALID: _errors.Invalid, lib.RC_REFUSED: _errors.Refused, lib.RC_LOST: _errors.Lost, lib.RC_TIMEOUT: _errors.Timeout}
SLICE = 0.1  # seconds between two looks for Ctrl-C


def check(status: int) -> None:
    """Raises what a status means. On the thread of the call."""
    if status == lib.RC_OK:
        return
    sentence = ffi.string(lib.rc_message()).decode(errors="replace")
    if status == lib.RC_MEMORY:
        raise MemoryError(sentence)
    raise _ERRORS.get(status, _errors.Error)(sentence)


def interruptible(call: Callable[[], Any], undo: Callable[[], Any] = lambda: None) -> None:
    """Runs a call that may wait on a thread of its own, so that Ctrl-C is heard. Then the call ends by itself, by its timeout, holds what
    it uses until then, and `undo` drops what it made."""
    if threading.current_thread() is not threading.main_thread():
        return check(call())
    failure: "list[BaseException]" = []
    abandoned = threading.Event()

    def run() -> None:
        try:
            check(call())
            if abandoned.is_set():
                undo()
        except BaseException as e:
            failure.append(e)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(SLICE)
    except BaseException:
        abandoned.set()
        raise
    if failure:
        raise failure[0].with_traceback(None)


def in_slices(call: Callable[[float], None], timeout: float) -> None:
    """Repeats a call that times out, so that Ctrl-C is heard in between; and one that waited for a lost connection: a loss that is told at
    once is final."""
    if not timeout >= 0:
        raise _errors.Invalid("a timeout is 0 seconds or more")
    until = time.monotonic() + timeout
    while True:
        began = time.monotonic()
        slice = min(SLICE, max(until - began, 0.001))
        try:
            return call(slice)
        except (_errors.Timeout, _errors.Lost) as e:
            now = time.monotonic()
            if now >= until or (isinstance(e, _errors.Lost) and now - began < slice / 2):
                raise


_PROCESS = os.getpid()


def owned(handle: Any, close: Callable[[Any], Any]) -> Any:
    """The handle, closed when nothing refers to it any more. A process that was forked has none of its threads, and leaves it alone."""
    return ffi.gc(handle, lambda h: close(h) if os.getpid() == _PROCESS else None)


def usable(handle: Any, what: str) -> Any:
    """A handle of a world or ground, unless it was closed or belongs to the process that this one was forked from."""
    if handle == ffi.NULL:
        raise _errors.Invalid(f"this {what} is closed")
    if os.getpid() != _PROCESS:
        raise _errors.Invalid(f"this {what} belongs to the process that was forked: start processes by 'spawn', and join there")
    return handle


def text(value: "str | os.PathLike[str] | None") -> Any:
    """A C string; keep it as long as it is used."""
    if value is None:
        return ffi.NULL
    encoded = os.fsencode(value)
    if b"\0" in encoded:
        raise _errors.Invalid("a name or a path has no character 0")
    return ffi.new("char[]", encoded)


def struct(name: str, /, **values: Any) -> Any:
    """A pointer to a struct that says its size."""
    try:
        return ffi.new(f"{name}*", {"size": ffi.sizeof(name), **values})
    except OverflowError as e:
        raise _errors.Invalid(str(e)) from None


def places(array: ArrayLike, last: int, what: str) -> NDArray[np.float64]:
    """float64, contiguous, of shape (..., last); a copy only where it is not that already."""
    out = np.ascontiguousarray(array, dtype=np.float64)
    if out.ndim == 0 or out.shape[-1] != last:
        raise _errors.Invalid(f"{what} are an array of shape (..., {last}), not {out.shape}")
    return out


def doubles(array: NDArray[np.float64]) -> Any:
    return ffi.from_buffer("double[]", array)
