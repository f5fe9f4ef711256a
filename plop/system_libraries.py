"""The system libraries that plop's packages link to but do not include, and the Debian packages that contain them.

Plain Python of any version and without imports of plop: `make setup` reads this before anything is installed.
"""

import ctypes
import sys

PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libidn2.so.0": "libidn2-0",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""Library -> package. libgomp is numba's OpenMP layer; all others are what `readelf -d libOpen3D.so` lists: linked with
immediate binding, so that even ray casting, which calls none of them, does not load without them."""


def missing_packages() -> "list[str]":
    """Return the Debian packages whose library cannot be loaded, sorted; none on other systems than Linux."""
    found = set()
    for library, package in PACKAGES.items() if sys.platform.startswith("linux") else ():
        try:
            ctypes.CDLL(library)
        except OSError:
            found.add(package)
    return sorted(found)


def install_command(packages: "list[str]") -> str:
    """Return the one command that installs packages on Debian and Ubuntu."""
    return "apt-get install -y {}".format(" ".join(packages))
