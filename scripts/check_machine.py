"""Check the requirements of `make setup` before it installs anything, and install missing system packages.

Plain Python, any version. On Debian and Ubuntu missing packages are installed with apt-get: as root, or through a sudo
without a password. Without either, the command is printed and the exit code is 1.

Usage: python3 scripts/check_machine.py
"""

import importlib.util
import os
import shutil
import subprocess
import sys

LIBRARIES = os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "plop", "system_libraries.py")
_spec = importlib.util.spec_from_file_location("system_libraries", LIBRARIES)
libraries = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(libraries)  # by its path: `import plop` would require a Python that may be missing


def needed_packages():
    """Return the Debian packages that are missing: libraries, and venv, which Debian splits from Python."""
    found = libraries.missing_packages()
    if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
        found.append("python{}.{}-venv".format(*sys.version_info[:2]))
    return found


def root_prefix():
    """Return the prefix of a command to run it as root without a prompt; None when there is none."""
    if not shutil.which("apt-get"):
        return None
    if os.geteuid() == 0:
        return []
    sudo = shutil.which("sudo")
    if sudo and subprocess.call([sudo, "-n", "true"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0:
        return [sudo, "-n"]
    return None


def install(packages, prefix):
    """Install packages; return the output of apt-get when it failed, else ''."""
    how = "with sudo" if prefix else "as root"
    sys.stdout.write("installing system packages ({}): {}\n".format(how, " ".join(packages)))
    sys.stdout.flush()
    apt = prefix + ["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]
    # an unreachable source fails the update but not the packages of the others
    subprocess.call(apt + ["update", "-qq"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    words = apt + libraries.install_command(packages).split()[1:] + ["-qq", "--no-install-recommends"]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    said = done.stdout.decode(errors="replace").strip().splitlines()
    return (said[-1] if said else "exit code {}".format(done.returncode)) if done.returncode else ""


def problems():
    """List what is still missing, each with its remedy."""
    if sys.version_info < (3, 11):
        here = "{}.{}".format(*sys.version_info[:2])
        return ["Python 3.11 or newer is needed, this is {}: make PYTHON=/path/to/python3.11 setup".format(here)]
    packages, said = needed_packages(), ""
    prefix = root_prefix() if packages else None
    if prefix is not None:
        said = install(packages, prefix)
        importlib.invalidate_caches()
        packages = needed_packages()
    if not packages:
        return []
    why = " ({})".format(said) if said else ""
    command = libraries.install_command(packages)
    return ["system packages are missing{}. On Debian and Ubuntu, as root: {}".format(why, command)]


if __name__ == "__main__":
    lines = problems()
    for line in lines:
        sys.stderr.write("plop: " + line + "\n")
    sys.exit(1 if lines else 0)
