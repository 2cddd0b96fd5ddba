#!/usr/bin/env python3
"""Makes a wheel of the package quarry with libquarry inside, for `pip install`. The library's own libraries are the system's (Debian 12).
Usage: make_wheel.py LIBRARY VERSION FOLDER"""
import base64
import hashlib
import pathlib
import platform
import sys
import zipfile

PACKAGE = pathlib.Path(__file__).parent / "quarry"


def main():
    library, version, folder = pathlib.Path(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3])
    tag = f"py3-none-linux_{platform.machine()}"
    info = f"quarry-{version}.dist-info"
    files = {f"quarry/{path.name}": path.read_bytes() for path in sorted(PACKAGE.glob("*.py*"))  if path.is_file()}
    files["quarry/libquarry.so.0"] = library.read_bytes()
    files[f"{info}/METADATA"] = (f"Metadata-Version: 2.1\nName: quarry\nVersion: {version}\nSummary: Rays through triangle models that do not fit memory\n"
                                 "Requires-Python: >=3.9\nRequires-Dist: numpy\n").encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: make_wheel\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    digests = {name: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode() for name, data in files.items()}
    files[f"{info}/RECORD"] = "".join([f"{name},sha256={digests[name]},{len(data)}\n" for name, data in files.items()] + [f"{info}/RECORD,,\n"]).encode()
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(folder / f"quarry-{version}-{tag}.whl", "w", zipfile.ZIP_DEFLATED) as wheel:
        for name, data in files.items():
            wheel.writestr(zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)


main()
