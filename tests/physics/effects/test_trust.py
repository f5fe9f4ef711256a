"""Effect files that came inside a model run only when their content was trusted."""

from __future__ import annotations

import json
import os
import py_compile
from pathlib import Path

import pytest

from plop.dynamics.i2n.model_io import MODEL_SCHEMA
from plop.models import effects_of, load_model
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.effects import trust
from plop.physics.effects.trust import UntrustedEffectError, remember, trusting
from plop_cli.app import main
from tests.support.coarse_episodes import BASE

LAW = """
from pathlib import Path

from plop.physics.effects.effect import Effect
from plop.parameters import Parameter

Path({marker!r}).touch()


class Mine(Effect):
    name = "mine"
    help = law = source = "test"
    amplitudes = (Parameter("a", "-", 0.0, 1.0, step=0.1),)

    def before(self, body, dt):
        body.v[:, 0] += self["a"] * dt
"""


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv(trust.TRUST, raising=False)


@pytest.fixture
def marker(tmp_path: Path) -> Path:
    return tmp_path / "it-ran"


@pytest.fixture
def model(tmp_path: Path, marker: Path) -> Path:
    """A stranger's augmented engine, with an effect file that leaves a mark when it runs."""
    folder = tmp_path / "model"
    engine = {"schema": MODEL_SCHEMA, "engine": base_to_dict(BASE), "training": {}}
    added = [{"effect": "mine", "parameters": {"a": {"value": 0.5}}}]
    for place, facts in ((folder / "base", {"kind": "engine"}), (folder, {"kind": "augmented", "effects": added})):
        place.mkdir(parents=True, exist_ok=True)
        (place / "model.json").write_text(json.dumps(engine | facts))
    (folder / "effects").mkdir()
    (folder / "effects" / "mine.py").write_text(LAW.format(marker=str(marker)))
    return folder


def test_a_strangers_effect_does_not_run_unasked(model: Path, marker: Path):
    for read in (effects_of, load_model):
        with pytest.raises(UntrustedEffectError, match="--trust-effects") as caught:
            read(model)
        assert "mine.py" in str(caught.value.where)
    assert not marker.exists()


def test_trust_is_remembered_for_the_content_and_for_nothing_else(model: Path, marker: Path):
    with trusting(True):
        assert effects_of(model)[0]["a"] == 0.5
    assert marker.exists() and trust.TRUST not in os.environ
    marker.unlink()
    assert effects_of(model)[0].name == "mine", "remembered"
    assert marker.exists()
    marker.unlink()
    file = model / "effects" / "mine.py"
    file.write_text(file.read_text() + "\n# another content\n")
    with pytest.raises(UntrustedEffectError):
        effects_of(model)
    assert not marker.exists()


def test_a_second_untrusted_file_beside_a_trusted_one_is_named(model: Path, marker: Path):
    remember(model / "effects" / "mine.py")
    other = model / "effects" / "other.py"
    other.write_text(f"from pathlib import Path\nPath({str(marker)!r}).touch()\n")
    with pytest.raises(UntrustedEffectError) as caught:
        effects_of(model)
    assert caught.value.files == [other] and not marker.exists()


def test_byte_code_beside_a_trusted_file_is_not_read(model: Path, marker: Path, tmp_path: Path):
    file, evil = model / "effects" / "mine.py", tmp_path / "evil.py"
    remember(file)
    stamp = file.stat()
    evil.write_text("raise SystemExit('byte code of a stranger')\n".ljust(stamp.st_size)[: stamp.st_size])
    os.utime(evil, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    py_compile.compile(str(evil), cfile=str(file.parent / "__pycache__" / f"mine.{_tag()}.pyc"), doraise=True)
    assert effects_of(model)[0].name == "mine"
    assert sorted(p.name for p in file.parent.iterdir()) == ["__pycache__", "mine.py"]


def _tag() -> str:
    import sys

    return str(sys.implementation.cache_tag)


def test_a_copy_that_was_tampered_with_is_not_trusted(model: Path, marker: Path):
    file = model / "effects" / "mine.py"
    remember(file)
    (copy,) = trust.folder().rglob("mine.py")
    copy.write_text("raise SystemExit")
    with pytest.raises(UntrustedEffectError):
        effects_of(model)


def test_a_home_that_cannot_be_written_is_no_error(model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "file"))
    remember(model / "effects" / "mine.py")
    with pytest.raises(UntrustedEffectError):
        effects_of(model)


def test_the_terminal_is_asked_and_the_command_repeated(monkeypatch: pytest.MonkeyPatch, model: Path, capsys):
    from plop_cli import app

    asked: list[bool] = []
    given = ["rollout", "--help"]
    monkeypatch.setattr(app.sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(app.sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(app.typer, "confirm", lambda *words, **more: asked.append(True) or False)
    error = UntrustedEffectError([model / "effects" / "mine.py"])
    assert not app._trusts(error, given) and asked == [True]
    assert not app._trusts(error, [*given, "--json"]) and asked == [True]


def test_a_settings_file_cannot_name_a_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "plop.toml").write_text('[simulate.cameras]\nrenderer = "blender"\nblender = "./evil"\n')
    found = main(["simulate", "block.toml", "-w", str(tmp_path), "--dry-run"])
    told = capsys.readouterr().err
    assert found == 1 and "names a program" in told and "--" in told
