"""What `make setup` and the first commands do on a machine that lacks something."""

from __future__ import annotations

import importlib
import importlib.util
import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from plop import lazy_open3d, system_libraries
from plop.errors import PlopError
from stages.train.journal import Journal

ROOT = Path(__file__).resolve().parent.parent
OF_APPS = "import plop_cli.app, stages; [ref.load() for ref in stages.PIPELINE]"


@pytest.fixture
def check(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """Load scripts/check_machine.py for a machine on which libthing is missing until apt-get was asked for it."""
    spec = importlib.util.spec_from_file_location("check_machine", ROOT / "scripts" / "check_machine.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(
        module.libraries, "missing_packages", lambda: [] if (tmp_path / "libthing").exists() else ["libthing"]
    )
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    return module


def program(path: Path, text: str) -> None:
    path.write_text(f"#!/bin/sh\ncd {path.parent}\n{text}\n")
    path.chmod(0o755)


APT = """echo "apt-get $*" >> said
[ "$1" = update ] && exit 100
for word; do case $word in lib*) touch $word;; esac; done"""


def test_root_installs_what_is_missing_and_says_so_in_one_line(check, monkeypatch, tmp_path, capfd):
    program(tmp_path / "apt-get", APT)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert check.problems() == []
    assert capfd.readouterr().out == "installing system packages (as root): libthing\n"
    assert "install -y libthing" in (tmp_path / "said").read_text()
    assert check.problems() == [] and capfd.readouterr().out == "", "what is there is not installed again"


@pytest.mark.parametrize("asks_for_password", [False, True])
def test_sudo_is_used_where_it_asks_for_nothing(check, monkeypatch, tmp_path, capfd, asks_for_password):
    program(tmp_path / "apt-get", APT)
    program(tmp_path / "sudo", "exit 1" if asks_for_password else 'shift; exec "$@"')
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    found = check.problems()
    out = capfd.readouterr().out
    if asks_for_password:
        (line,) = found
        assert "as root: apt-get install -y libthing" in line and out == ""
        assert not (tmp_path / "said").exists()
    else:
        assert found == [] and out == "installing system packages (with sudo): libthing\n"


def test_a_failing_apt_get_is_quoted(check, monkeypatch, tmp_path):
    program(tmp_path / "apt-get", "echo 'E: Unable to locate package libthing'; exit 100")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    (line,) = check.problems()
    assert "Unable to locate package libthing" in line and "apt-get install" in line


def test_without_apt_get_the_packages_are_named(check, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    (line,) = check.problems()
    assert "libthing" in line


def test_no_stage_loads_open3d_until_it_casts_a_ray():
    code = f"{OF_APPS}; import sys; print('LOADED', 'open3d' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "LOADED False" in done.stdout


def test_a_missing_system_library_is_named_with_its_package(monkeypatch):
    def broken(name: str) -> None:
        raise ImportError("libX11.so.6: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(importlib, "import_module", broken)
    monkeypatch.setattr(lazy_open3d, "missing_packages", lambda: ["libgl1", "libx11-6"])
    with pytest.raises(PlopError) as caught:
        _ = lazy_open3d.o3d.t
    assert "libX11.so.6" in caught.value.found and "apt-get install" in caught.value.fix
    assert "libgl1 libx11-6" in caught.value.fix


def test_open3d_that_is_not_installed_is_told_apart(monkeypatch):
    def absent(name: str) -> None:
        raise ModuleNotFoundError("No module named 'open3d'", name="open3d")

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(PlopError) as caught:
        lazy_open3d.load_open3d()
    assert "pip install open3d-cpu" in caught.value.fix


@pytest.mark.skipif(sys.platform != "linux", reason="reads ELF files")
def test_the_list_of_system_libraries_is_what_open3d_links_to():
    folder = Path(importlib.util.find_spec("open3d").submodule_search_locations[0])
    (library,) = [path for path in folder.rglob("libOpen3D.so*") if not path.is_symlink()]
    text = library.read_bytes()
    own = ("libEGL.so.1", "libGL.so.1", "libX11.so.6", "libidn2.so.0", "libudev.so.1", "libusb-1.0.so.0")
    assert all(name.encode() + b"\0" in text for name in own) and set(own) < set(system_libraries.PACKAGES)


def test_libraries_that_are_there_are_not_missed(monkeypatch):
    monkeypatch.setattr(system_libraries, "PACKAGES", {"libc.so.6": "libc6", "libnothing.so.7": "libnothing7"})
    assert system_libraries.missing_packages() == (["libnothing7"] if sys.platform == "linux" else [])


def test_training_is_logged_without_tensorboard(monkeypatch, tmp_path):
    original = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "tensorboard" else original(name, *more)
    )
    with Journal.open(tmp_path, 0, enabled=True) as journal:
        journal.write(0, 1.0, {"track": 1.0})
    assert (tmp_path / "log.jsonl").read_text().count("\n") == 1 and not (tmp_path / "tensorboard").exists()


def test_versions_and_licence_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {project['version']}\n" in citation and f"license: {project['license']}\n" in citation
    assert "Apache License" in (ROOT / "LICENSE").read_text()[:200] and project["license"] == "Apache-2.0"
    assert metadata.version("plop") == project["version"]


def test_blenders_picture_is_read_without_its_alpha(tmp_path):
    from PIL import Image

    from plop.render.virtual_cameras.blender import read_picture

    colours = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    Image.fromarray(np.dstack([colours, np.full((4, 4), 7, np.uint8)])).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.png"), colours)


@pytest.mark.parametrize(
    "pip_has, uv_has, expected",
    [("+cpu", "", "pip +cpu"), ("", "cpu", "uv cpu"), ("", "", "pip any"), ("", "cu128", "uv cu128")],
)
def test_the_cpu_build_of_torch_is_taken_wherever_it_can_be_had(tmp_path, pip_has, uv_has, expected):
    program(
        tmp_path / "python",
        f"""case "$*" in
        *torch==*+cpu) [ "{pip_has}" = +cpu ] || exit 1; echo "pip +cpu" >> said;;
        *torch==*) echo "pip any" >> said;; esac""",
    )
    program(
        tmp_path / "uv",
        f"""case "$*" in
        *--torch-backend={uv_has or "nothing"}\\ torch==*) echo "uv {uv_has}" >> said;; *) exit 1;; esac""",
    )
    build = [uv_has] if uv_has.startswith("cu") else []
    done = subprocess.run(
        ["sh", str(ROOT / "scripts" / "install_torch.sh"), str(tmp_path / "python"), *build],
        env={"PATH": f"{tmp_path}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and (tmp_path / "said").read_text().split("\n")[:-1] == [expected]
    assert ("CUDA" in done.stderr) == (expected == "pip any"), "never without a word"
