"""What this machine can do: every part plop needs or can use, and how to get what is missing."""

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
from plop_cli.console import Console

LIBRARIES_FIX = "apt-get install -y libusb-1.0-0 libx11-6 libgl1 libegl1 libgomp1"
ZED_FOLDER = Path("/usr/local/zed")
"""Where the ZED SDK's installer puts it."""


@dataclass(frozen=True)
class Finding:
    """One part of the machine."""

    part: str
    state: str
    """"ok", "absent" (plop works without it) or "problem"."""
    detail: str
    remedy: str = ""


def examine(store: Store) -> list[Finding]:
    """Look at every part; a part that breaks is a finding, never an error."""
    checks: list[tuple[str, Callable[[], Finding]]] = [
        ("python", _python), ("torch", _torch), ("cuda", _cuda), ("gsplat", _gsplat), ("cores and memory", _cores),
        ("disk", lambda: _disk(store.workspace)), ("numba", _numba), ("open3d", _open3d), ("opencv", _opencv),
        ("pycolmap", lambda: _package("pycolmap", "pycolmap", "pip install pycolmap", needed=True)),
        ("ffmpeg", _ffmpeg), ("usd-core", _usd), ("Blender", _blender), ("LPIPS backbone", _lpips),
        ("ZED SDK", _zed), ("rerun-sdk", lambda: _package("rerun-sdk", "rerun", "pip install -e '.[view]'")),
    ]  # fmt: skip
    found = []
    for part, check in checks:
        try:
            found.append(check())
        except Exception as error:  # a broken part must not hide the others
            found.append(Finding(part, "problem", f"{type(error).__name__}: {error}"))
    return found


def show(store: Store, console: Console) -> int:
    """Print the findings; return 1 when a needed part is broken."""
    findings = examine(store)
    console.table([asdict(finding) for finding in findings])
    console.result([asdict(finding) for finding in findings])
    return 1 if any(finding.state == "problem" for finding in findings) else 0


def _python() -> Finding:
    fine = sys.version_info >= (3, 11)
    state, remedy = ("ok", "") if fine else ("problem", "use 3.11 or newer")
    return Finding("python", state, platform.python_version(), remedy)


def _torch() -> Finding:
    import torch

    device = "cuda" if torch.cuda.is_available() else "cpu"
    return Finding("torch", "ok", f"{torch.__version__}, device {device}, {torch.get_num_threads()} threads")


def _cuda() -> Finding:
    import torch

    if not torch.cuda.is_available():
        return Finding("cuda", "absent", "no CUDA device, or a CPU build of torch; everything runs on the CPU",
                       "with a GPU: install a CUDA build of torch")  # fmt: skip
    free, total = torch.cuda.mem_get_info()
    return Finding("cuda", "ok", f"{torch.cuda.get_device_name()}, {free / 2**30:.0f} of {total / 2**30:.0f} GiB free")


def _gsplat() -> Finding:
    if importlib.util.find_spec("gsplat") is None:
        return Finding("gsplat", "absent", "the renderer on CUDA; the CPU has its own", "pip install -e '.[cuda]'")
    return Finding("gsplat", "ok", f"{metadata.version('gsplat')} (compiled on first use, on CUDA only)")


def _cores() -> Finding:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return Finding("cores and memory", "ok", f"{cores} cores, {memory:.1f} GiB, OMP_NUM_THREADS {threads}")


def _disk(workspace: Path) -> Finding:
    folder = next(path for path in [workspace, *workspace.parents] if path.exists())
    free = shutil.disk_usage(folder).free / 2**30
    state = "ok" if free > 1 else "problem"
    return Finding("disk", state, f"{free:.1f} GiB free for {workspace}", "" if free > 1 else "free some space")


def _numba() -> Finding:
    import numba

    return Finding("numba", "ok", f"{numba.__version__}, {numba.config.NUMBA_NUM_THREADS} threads")


def _open3d() -> Finding:
    try:
        module = importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        return Finding("open3d", "problem", str(error), LIBRARIES_FIX)
    return Finding("open3d", "ok", str(module.__version__))


def _opencv() -> Finding:
    cv2 = importlib.import_module("cv2")
    if not hasattr(cv2, "calibrateHandEye"):
        return Finding("opencv", "problem", f"{cv2.__version__} has no calibrateHandEye",
                       "pip install 'opencv-python-headless>=4.12,<5'")  # fmt: skip
    return Finding("opencv", "ok", str(cv2.__version__))


def _package(part: str, module: str, remedy: str, *, needed: bool = False) -> Finding:
    if importlib.util.find_spec(module) is None:
        return Finding(part, "problem" if needed else "absent", "not installed", remedy)
    return Finding(part, "ok", metadata.version(part))


def _ffmpeg() -> Finding:
    import imageio_ffmpeg

    return Finding("ffmpeg", "ok", f"{imageio_ffmpeg.get_ffmpeg_version()} (of imageio-ffmpeg)")


def _usd() -> Finding:
    if importlib.util.find_spec("pxr") is None:
        return Finding("usd-core", "absent", "needed by `plop ingest disect` only", "pip install -e '.[disect]'")
    return Finding("usd-core", "ok", metadata.version("usd-core"))


def _blender() -> Finding:
    program = shutil.which("blender")
    if program is None and importlib.util.find_spec("bpy") is None:
        return Finding("Blender", "absent", "for `plop ingest disect --renderer blender`; raycast needs nothing",
                       "install Blender, or give its executable with --blender")  # fmt: skip
    return Finding("Blender", "ok", program or "the package bpy")


def _lpips() -> Finding:
    from plop.metrics.lpips import BACKBONE_FILES, Unavailable, load_lpips

    loaded = load_lpips("alex")
    if isinstance(loaded, Unavailable):
        file = BACKBONE_FILES["alex"]
        remedy = f"put {file} into $TORCH_HOME/hub/checkpoints, or name it with `plop eval --lpips-backbone`"
        return Finding("LPIPS backbone", "absent", loaded.reason, remedy)
    return Finding("LPIPS backbone", "ok", "LPIPS is scored")


def _zed() -> Finding:
    if importlib.util.find_spec("pyzed") is None and not ZED_FOLDER.is_dir():
        return Finding("ZED SDK", "absent", "needed to read depth from SVO files of DROID recordings",
                       "install the ZED SDK, or extract depth elsewhere first")  # fmt: skip
    python = "with" if importlib.util.find_spec("pyzed") is not None else "without"
    return Finding("ZED SDK", "ok", f"{python} its Python package pyzed")
