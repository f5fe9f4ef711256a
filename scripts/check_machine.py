"""Check what `make setup` needs before it installs anything; plain Python, any version.

Usage: python3 scripts/check_machine.py
"""

import ctypes
import importlib.util
import sys

LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libX11.so.6": "libx11-6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
}


def missing_packages():
    """Give the Debian packages whose library cannot be loaded."""
    found = []
    for library, package in sorted(LIBRARIES.items()):
        try:
            ctypes.CDLL(library)
        except OSError:
            found.append(package)
    return found


def problems():
    """List what is missing, each with its remedy."""
    found = []
    if sys.version_info < (3, 11):
        found.append(
            "Python 3.11 or newer is needed, this is {}.{}: make PYTHON=/path/to/python3.11 setup".format(
                *sys.version_info[:2]
            )
        )
    if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
        found.append("Python's venv module is missing: apt-get install -y python3-venv")
    packages = missing_packages() if sys.platform.startswith("linux") else []
    if packages:
        found.append(
            "system libraries are missing: apt-get install -y {}   (as root; or: make system-libs)".format(
                " ".join(packages)
            )
        )
    return found


if __name__ == "__main__":
    lines = problems()
    for line in lines:
        sys.stderr.write("plop: " + line + "\n")
    sys.exit(1 if lines else 0)
