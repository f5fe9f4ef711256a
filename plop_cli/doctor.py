"""Check of this machine: every component that plop needs or can use, and how to install missing ones."""

from __future__ import annotations

import importlib
import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from plop.artifacts.store import Store
from plop.installed import install_extra, install_package
from plop_cli.console import Console

LIBRARIES_FIX = "apt-get install -y libusb-1.0-0 libx11-6 libgl1 libegl1 libgomp1"
ZED_FOLDER = Path("/usr/local/zed")
"""Default path of the ZED SDK."""
OK, OPTIONAL, PROBLEM = "ok", "optional", "problem"


@dataclass(frozen=True)
class Finding:
    """One component of the machine."""

    part: str
    group: str
    """"needed" or "optional"."""
    state: str
    """"ok"; "optional" (missing, and plop works without it); or "problem"."""
    detail: str
    remedy: str = ""


@dataclass(frozen=True)
class Look:
    """Result of checking one component."""

    there: bool
    detail: str
    remedy: str = ""


@dataclass(frozen=True)
class Part:
    """One component that plop needs or can use: a row of the table below."""

    name: str
    look: Callable[[Store], Look]
    needed: bool = True
    use: str = ""
    """Use of an optional component."""


def examine(store: Store) -> list[Finding]:
    """Check every component, needed ones first; a broken component is a finding, never an error."""
    return [_finding(part, store) for part in sorted(PARTS, key=lambda part: not part.needed)]


def _finding(part: Part, store: Store) -> Finding:
    group = "needed" if part.needed else "optional"
    try:
        look = part.look(store)
    except Exception as error:  # a broken component must not hide the others, but an installed one should work
        return Finding(part.name, group, PROBLEM, f"{type(error).__name__}: {error}", f"install {part.name} again")
    state = OK if look.there else PROBLEM if part.needed else OPTIONAL
    detail = look.detail if look.there or not part.use else f"{look.detail}: {part.use}"
    return Finding(part.name, group, state, detail, look.remedy)


def show(store: Store, console: Console) -> int:
    """Print the findings in two groups; return 1 when a needed part is missing or an installed one is broken."""
    findings = examine(store)
    for group in ("needed", "optional"):
        console.table(
            [
                {key: value for key, value in asdict(finding).items() if key != "group"}
                for finding in findings
                if finding.group == group
            ],
            title=group,
        )
        console.say("")
    broken = [finding.part for finding in findings if finding.state == PROBLEM]
    missing = [finding.part for finding in findings if finding.state == OPTIONAL]
    console.say(
        f"needs repair: {', '.join(broken)}"
        if broken
        else "everything that plop needs is installed"
        + (f"; missing but optional: {', '.join(missing)}" if missing else "")
    )
    console.result([asdict(finding) for finding in findings])
    return 1 if broken else 0


def _python(store: Store) -> Look:
    return Look(
        sys.version_info >= (3, 11),
        platform.python_version(),
        "" if sys.version_info >= (3, 11) else "use Python 3.11 or newer",
    )


def _torch(store: Store) -> Look:
    import torch

    device = "cuda" if torch.cuda.is_available() else "cpu"
    return Look(True, f"{torch.__version__}, device {device}, {torch.get_num_threads()} threads")


def _cuda(store: Store) -> Look:
    import torch

    if not torch.cuda.is_available():
        return Look(False, "no CUDA device, or a CPU build of torch", "with a GPU: install a CUDA build of torch")
    free, total = torch.cuda.mem_get_info()
    return Look(True, f"{torch.cuda.get_device_name()}, {free / 2**30:.0f} of {total / 2**30:.0f} GiB free")


def _cores(store: Store) -> Look:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return Look(True, f"{cores} cores, {memory:.1f} GiB, OMP_NUM_THREADS {threads}")


def _disk(store: Store) -> Look:
    workspace = store.workspace
    folder = next(path for path in [workspace, *workspace.parents] if path.exists())
    free = shutil.disk_usage(folder).free / 2**30
    return Look(free > 1, f"{free:.1f} GiB free for {workspace}", "" if free > 1 else "free some space")


def _numba(store: Store) -> Look:
    import numba

    return Look(True, f"{numba.__version__}, {numba.config.NUMBA_NUM_THREADS} threads")


def _open3d(store: Store) -> Look:
    try:
        module = importlib.import_module("open3d")
    except OSError as error:
        return Look(False, str(error), LIBRARIES_FIX)
    except ImportError as error:
        shared = "cannot open shared object" in str(error)
        return Look(False, str(error), LIBRARIES_FIX if shared else install_package("open3d"))
    return Look(True, str(module.__version__))


def _opencv(store: Store) -> Look:
    cv2 = importlib.import_module("cv2")
    if not hasattr(cv2, "calibrateHandEye"):
        return Look(
            False, f"{cv2.__version__} has no calibrateHandEye", install_package("opencv-python-headless>=4.12,<5")
        )
    return Look(True, str(cv2.__version__))


def _package(name: str, module: str, extra: str = "") -> Callable[[Store], Look]:
    """Check a package; `extra` of plop that installs it, else it is installed by its own name."""

    def look(store: Store) -> Look:
        if importlib.util.find_spec(module) is None:
            return Look(False, "not installed", install_extra(extra) if extra else install_package(name))
        return Look(True, metadata.version(name))

    return look


def _ffmpeg(store: Store) -> Look:
    import imageio_ffmpeg

    return Look(True, f"{imageio_ffmpeg.get_ffmpeg_version()} (of imageio-ffmpeg)")


def _blender(store: Store) -> Look:
    program = shutil.which("blender")
    if program is None and importlib.util.find_spec("bpy") is None:
        return Look(False, "not installed", "install Blender, or set its executable with --cameras.blender")
    return Look(True, program or "the package bpy")


def _lpips(store: Store) -> Look:
    from plop.metrics.lpips import BACKBONE_FILES, Unavailable, load_lpips

    loaded = load_lpips("alex")
    if isinstance(loaded, Unavailable):
        file = BACKBONE_FILES["alex"]
        remedy = f"put {file} into $TORCH_HOME/hub/checkpoints, or set its path with `plop eval --lpips-backbone`"
        return Look(False, loaded.reason.rstrip("."), remedy)
    return Look(True, "LPIPS is scored")


def _zed(store: Store) -> Look:
    if importlib.util.find_spec("pyzed") is None and not ZED_FOLDER.is_dir():
        return Look(False, "not installed", "install the ZED SDK, or extract depth elsewhere first")
    python = "with" if importlib.util.find_spec("pyzed") is not None else "without"
    return Look(True, f"{python} its Python package pyzed")


PARTS = (
    Part("python", _python),
    Part("cores and memory", _cores),
    Part("disk", _disk),
    Part("torch", _torch),
    Part("numba", _numba),
    Part("open3d", _open3d),
    Part("opencv", _opencv),
    Part("pycolmap", _package("pycolmap", "pycolmap")),
    Part("ffmpeg", _ffmpeg),
    Part("cuda", _cuda, needed=False, use="everything runs on the CPU without it, slower"),
    Part("gsplat", _package("gsplat", "gsplat", "cuda"), needed=False, use="the renderer on CUDA; the CPU has its own"),
    Part("usd-core", _package("usd-core", "pxr", "disect"), needed=False, use="for `plop ingest disect`"),
    Part("Blender", _blender, needed=False, use="for `plop ingest disect --cameras.renderer blender`"),
    Part("LPIPS backbone", _lpips, needed=False, use="for the score LPIPS of `plop eval`"),
    Part("ZED SDK", _zed, needed=False, use="for depth from SVO files of DROID recordings"),
    Part("rerun-sdk", _package("rerun-sdk", "rerun", "view"), needed=False, use="for `plop view`"),
)
"""All components; `needed` selects the group."""
