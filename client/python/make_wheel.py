"""Makes the wheel, and beside it the package's folder without the programs, for Debian's package: make_wheel.py LIBRARY SERVER VERSION OUT.
The package calls the library through cffi, which reads ridgecast.h;
so one wheel does for every Python from 3.9 on, and nothing is compiled when it is installed."""

import base64
import contextlib
import hashlib
import io
import re
import sys
import sysconfig
import zipfile
from pathlib import Path

import cffi

HERE = Path(__file__).parent
METADATA = """Metadata-Version: 2.1
Name: ridgecast
Version: {version}
Summary: Endless terrain for simulations: true heights anywhere, shared sessions, the ground as triangles
License: Apache-2.0
Requires-Python: >=3.9
Requires-Dist: cffi>=1.15
Requires-Dist: numpy>=1.21
Description-Content-Type: text/markdown

"""


def binding(folder: Path) -> bytes:
    """The module that cffi makes of the header's declarations."""
    header = (HERE.parent / "c/ridgecast.h").read_text()
    header = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    header = re.sub(r'#ifdef __cplusplus.*?#endif', "", header, flags=re.S)
    ffi = cffi.FFI()
    ffi.set_source("ridgecast._binding", None)
    ffi.cdef(re.sub(r"^#.*$", "", header, flags=re.M))
    out = folder / "_binding.py"
    with contextlib.redirect_stdout(io.StringIO()):  # it says which file it writes
        ffi.emit_python_code(str(out))
    made = out.read_bytes()
    out.unlink()
    return made


def main() -> None:
    library, server, version, out = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4])
    out.mkdir(parents=True, exist_ok=True)
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    info = f"ridgecast-{version}.dist-info"
    sources = [file for file in sorted((HERE / "ridgecast").iterdir()) if file.suffix in (".py", ".typed")]
    files = {f"ridgecast/{file.name}": file.read_bytes() for file in sources}
    files["ridgecast/_binding.py"] = binding(out)
    package = out / "ridgecast"
    package.mkdir(exist_ok=True)
    for name, data in files.items():
        (out / name).write_bytes(data)
    files["ridgecast/libridgecast.so.1"] = library.read_bytes()
    files["ridgecast/ridgecast-server"] = server.read_bytes()
    files[f"{info}/METADATA"] = (METADATA.format(version=version) + (HERE / "notebook.md").read_text()).encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: ridgecast\nRoot-Is-Purelib: false\nTag: py3-none-{platform}\n".encode()
    for notice in ("LICENSE", "packaging/THIRD_PARTY.md"):
        files[f"{info}/{Path(notice).name}"] = (HERE.parent.parent / notice).read_bytes()
    digest = {name: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode() for name, data in files.items()}
    record = "".join(f"{name},sha256={digest[name]},{len(data)}\n" for name, data in files.items()) + f"{info}/RECORD,,\n"
    wheel = out / f"ridgecast-{version}-py3-none-{platform}.whl"
    for old in out.glob("*.whl"):
        old.unlink()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {**files, f"{info}/RECORD": record.encode()}.items():
            entry = zipfile.ZipInfo(name)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if name.endswith("ridgecast-server") else 0o100644) << 16
            archive.writestr(entry, data)
    print(wheel)


if __name__ == "__main__":
    main()
