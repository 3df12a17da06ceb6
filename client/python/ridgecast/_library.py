"""The shared library: how its functions are called, and what their statuses become."""

import os
import threading
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


def interruptible(call: Callable[[], Any]) -> None:
    """Runs a call that may wait on a thread of its own, so that Ctrl-C is heard; then the call ends by itself, by its timeout."""
    if threading.current_thread() is not threading.main_thread():
        return check(call())
    failure: list[BaseException] = []

    def run() -> None:
        try:
            check(call())
        except BaseException as e:
            failure.append(e)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(SLICE)
    if failure:
        raise failure[0].with_traceback(None)


def text(value: "str | os.PathLike[str] | None") -> Any:
    """A C string; keep it as long as it is used."""
    return ffi.NULL if value is None else ffi.new("char[]", os.fsencode(value))


def struct(name: str, /, **values: Any) -> Any:
    """A pointer to a struct that says its size."""
    return ffi.new(f"{name}*", {"size": ffi.sizeof(name), **values})


def places(array: ArrayLike, last: int, what: str) -> NDArray[np.float64]:
    """float64, contiguous, of shape (..., last); a copy only where it is not that already."""
    out = np.ascontiguousarray(array, dtype=np.float64)
    if out.ndim == 0 or out.shape[-1] != last:
        raise _errors.Invalid(f"{what} are an array of shape (..., {last}), not {out.shape}")
    return out


def doubles(array: NDArray[np.float64]) -> Any:
    return ffi.from_buffer("double[]", array)
