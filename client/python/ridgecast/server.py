"""Runs a server of your own."""

import os
import shutil
import subprocess
import tempfile
import time
import weakref
from pathlib import Path
from typing import Any, List, Optional

from ._errors import Refused


def program(required: bool = True) -> Optional[str]:
    """ridgecast-server: the one in this package, otherwise the one in PATH."""
    beside = Path(__file__).parent / "ridgecast-server"
    found = str(beside) if beside.exists() else shutil.which("ridgecast-server")
    if found is None and required:
        raise Refused("there is no ridgecast-server in PATH: install it, or install this package from its wheel")
    return found


class Server:
    """A server that runs until `close`, or until this process ends; a context manager. `url` is for `join`, `http` for a browser and curl."""

    def __init__(self, arguments: List[str], timeout: float) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="ridgecast-")
        port, log = Path(self._folder.name) / "port", Path(self._folder.name) / "log"
        with open(log, "wb") as out:
            # The system closes its input when this process ends, whatever ends it. Ctrl-C is not for it.
            self._process = subprocess.Popen([str(program()), "--port-file", str(port), "--end-with-input", *arguments],
                                             stdin=subprocess.PIPE, stdout=out, stderr=subprocess.STDOUT, start_new_session=True)
        self._at_exit = weakref.finalize(self, _end, self._process, os.getpid())  # also when Python ends
        try:
            until = time.monotonic() + timeout
            while not (port.exists() and port.read_text().strip()):
                if self._process.poll() is not None or time.monotonic() > until:
                    raise Refused(f"the server did not start: {log.read_text(errors='replace').strip()[-500:]}")
                time.sleep(0.01)
        except BaseException:
            self.close()
            raise
        self.port = int(port.read_text())
        self.url = f"ws://127.0.0.1:{self.port}"
        self.http = f"http://127.0.0.1:{self.port}"

    def close(self) -> None:
        """Stops the server: SIGTERM first, SIGKILL if it has not ended after 10 s."""
        self._at_exit()
        self._folder.cleanup()

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _end(process: "subprocess.Popen[bytes]", parent: int) -> None:
    if os.getpid() != parent:
        return
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdin:
        process.stdin.close()


def server(terrain: str = "alpine", *, seed: int = 1, port: int = 0, timeout: float = 60.0, **options: Any) -> Server:
    """Runs a server on this machine: `with rc.server("canyon", seed=7) as s: rc.join(s.url)`.

    port 0: any free one. Other options are those of `ridgecast-server --help`, with _ for -: max_cameras=8, raster=["pitch=30"],
    quiet=True. Clients may ask for as many heights as they like, unless max_heights_per_second says otherwise.
    """
    options.setdefault("max_heights_per_second", 0)
    arguments = ["--terrain", str(terrain), "--seed", str(seed), "--port", str(port)]
    for key, value in options.items():
        flag = "--" + key.replace("_", "-")
        for one in value if isinstance(value, (list, tuple)) else [value]:
            if one is True:
                arguments.append(flag)
            elif one is not False and one is not None:
                arguments += [flag, str(one)]
    return Server(arguments, timeout)
