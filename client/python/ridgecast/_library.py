"""The shared library: how its functions are called, and which exceptions its statuses become."""

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
        raise ImportError(f"{e}; on Debian 12: apt install libdraco7 libssl3 libtiff6 libpng16-16") from None


lib: Any = _open()
version: str = ffi.string(lib.rc_version()).decode()

_ERRORS = {lib.RC_INVALID: _errors.Invalid, lib.RC_REFUSED: _errors.Refused, lib.RC_LOST: _errors.Lost, lib.RC_TIMEOUT: _errors.Timeout}
SLICE = 0.1  # seconds between checks for Ctrl-C


def check(status: int) -> None:
    """Raises the exception for a status. Must run on the thread of the call."""
    if status == lib.RC_OK:
        return
    sentence = ffi.string(lib.rc_message()).decode(errors="replace")
    if status == lib.RC_MEMORY:
        raise MemoryError(sentence)
    raise _ERRORS.get(status, _errors.Error)(sentence)


def interruptible(call: Callable[[], Any], undo: Callable[[], Any] = lambda: None) -> None:
    """Runs a call that may wait in a thread of its own, so that Ctrl-C interrupts the caller. The call then goes on until its timeout at
    the latest, keeps alive what it uses, and `undo` releases what it made."""
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
    """Repeats a call in short slices, so that Ctrl-C works in between. Repeats after Timeout, and after a Lost at a slice's end, where the
    call has waited for the connection; one that comes before is final."""
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
            if now >= until or (isinstance(e, _errors.Lost) and now - began < slice - 0.002):
                raise


_PROCESS = os.getpid()


def owned(handle: Any, close: Callable[[Any], Any]) -> Any:
    """The handle, closed when nothing refers to it any more. A forked process has none of its threads and does not close it."""
    return ffi.gc(handle, lambda h: close(h) if os.getpid() == _PROCESS else None)


def usable(handle: Any, what: str) -> Any:
    """The handle of a world or ground. Raises if it is closed or belongs to the process that this one was forked from."""
    if handle == ffi.NULL:
        raise _errors.Invalid(f"this {what} is closed")
    if os.getpid() != _PROCESS:
        raise _errors.Invalid(f"this {what} belongs to the process that was forked: start processes by 'spawn', and join there")
    return handle


def text(value: "str | os.PathLike[str] | None") -> Any:
    """A C string; the caller keeps a reference as long as it is used."""
    if value is None:
        return ffi.NULL
    encoded = os.fsencode(value)
    if b"\0" in encoded:
        raise _errors.Invalid("a name or a path has no character 0")
    return ffi.new("char[]", encoded)


def struct(name: str, /, **values: Any) -> Any:
    """A pointer to a new struct with its `size` set."""
    try:
        return ffi.new(f"{name}*", {"size": ffi.sizeof(name), **values})
    except OverflowError as e:
        raise _errors.Invalid(str(e)) from None


def real(array: ArrayLike, what: str) -> NDArray[np.float64]:
    """float64; copied only if it is not that already."""
    out = np.asarray(array)
    if out.dtype.kind not in "biuf":
        raise _errors.Invalid(f"{what} are real numbers, not {out.dtype}")
    return out.astype(np.float64, copy=False)


def places(array: ArrayLike, last: int, what: str) -> NDArray[np.float64]:
    """float64, contiguous, of shape (..., last); copied only if it is not that already."""
    out = np.ascontiguousarray(real(array, what))
    if out.ndim == 0 or out.shape[-1] != last:
        raise _errors.Invalid(f"{what} are an array of shape (..., {last}), not {out.shape}")
    return out


def doubles(array: NDArray[np.float64]) -> Any:
    return ffi.from_buffer("double[]", array)
