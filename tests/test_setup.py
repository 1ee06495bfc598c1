"""The installation: what the lock holds, and what ``tools/setup.py`` notices."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture
def setup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """``tools/setup.py`` at work in a folder of its own, with a pip that does nothing."""
    spec = importlib.util.spec_from_file_location("setup_tool", ROOT / "tools" / "setup.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in ("requirements.lock", "pyproject.toml"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(module, "STAMP", tmp_path / ".venv" / "complete")
    monkeypatch.setattr(module, "pip", lambda *_, **__: True)
    create = module.venv.create

    def create_without_pip(folder: Path, **options: bool) -> None:
        create(folder, **{**options, "with_pip": False})

    monkeypatch.setattr(module.venv, "create", create_without_pip)
    return module


def test_lock_pins_every_requirement_with_hashes() -> None:
    entries = re.split(r"\n(?=\S)", re.sub(r"^\s*#.*\n", "", LOCK, flags=re.MULTILINE).strip())
    assert len(entries) > 100
    for entry in entries:
        assert re.match(r"[a-z0-9.-]+==[^ ]+ .*\\\n +--hash=sha256:[0-9a-f]{64}", entry), entry


def test_both_locks_hold_the_same_versions() -> None:
    packages = tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8"))["package"]
    locked = {(p["name"], p["version"]) for p in packages if "registry" in p["source"]}
    pinned = set(re.findall(r"^([a-z0-9.-]+)==([^ ]+)", LOCK, flags=re.MULTILINE))
    assert {(name, version) for name, version in locked if name != "torch"} == pinned


def test_lock_names_no_place_and_no_torch() -> None:
    assert not re.search(r"://|file:|find-links|index-url|^ *-[^-]|^/", LOCK, flags=re.MULTILINE)
    assert not re.search(r"^(torch|nvidia[a-z0-9-]*)==", LOCK, flags=re.MULTILINE)


def test_lock_holds_what_the_project_asks_for() -> None:
    pins = dict(re.findall(r"^([a-z0-9.-]+)==([^ ]+)", LOCK, flags=re.MULTILINE))
    project = PROJECT["project"]
    extras = project["optional-dependencies"]
    torch, *weights = extras["learned"]
    asked = project["dependencies"] + extras["notebooks"] + extras["dev"] + weights
    for requirement in map(Requirement, asked + PROJECT["build-system"]["requires"]):
        assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)])
    assert torch == "torch==2.13.0"


@pytest.mark.parametrize("name", ["requirements.lock", "pyproject.toml"])
def test_a_change_or_half_a_stamp_asks_for_a_new_installation(setup: ModuleType, name: str) -> None:
    assert not setup.complete()
    setup.install(0)
    assert setup.complete()
    with (setup.ROOT / name).open("a") as file:
        file.write("\n")
    assert not setup.complete()
    setup.install(0)
    setup.STAMP.write_text(setup.fingerprint()[:20])
    assert not setup.complete()


def test_a_moved_installation_is_not_complete(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup.install(0)
    moved = setup.ROOT.rename(setup.ROOT.with_name("moved"))
    monkeypatch.setattr(setup, "ROOT", moved)
    monkeypatch.setattr(setup, "VENV", moved / ".venv")
    monkeypatch.setattr(setup, "STAMP", moved / ".venv" / "complete")
    assert setup.STAMP.is_file()
    assert not setup.complete()


def test_an_installation_that_was_broken_off_or_failed_is_made_anew(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken_off(*_: str, **__: int) -> bool:
        (setup.VENV / "half").touch()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(setup, "pip", broken_off)
        with pytest.raises(KeyboardInterrupt):
            setup.install(0)
        assert (setup.VENV / "half").exists()
        assert not setup.complete()
        patch.setattr(setup, "pip", lambda *_, **__: False)
        with pytest.raises(SystemExit, match="could not be installed"):
            setup.install(0)
        assert not setup.complete()
    setup.install(0)
    assert setup.complete()
    assert not (setup.VENV / "half").exists()


def test_without_torch_the_installation_is_complete(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(setup, "pip", lambda *arguments, **_: "torch" not in arguments[-1])
    setup.install(0)
    assert setup.complete()
    assert "went on without torch==2.13.0" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="names of Linux libraries")
@pytest.mark.parametrize(
    ("user", "has_apt", "tried"),
    [(1000, True, []), (0, False, []), (0, True, ["update", "libegl1"])],
    ids=["no root", "no apt", "apt fails"],
)
def test_missing_libraries_stop_with_the_line_that_installs_them(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, user: int, has_apt: bool, tried: list[str]
) -> None:
    ran: list[list[str]] = []
    monkeypatch.setattr(setup, "loads", lambda library: library != "libEGL.so.1")
    monkeypatch.setattr(setup.os, "geteuid", lambda: user)
    monkeypatch.setattr(setup.shutil, "which", lambda _: "/usr/bin/apt-get" if has_apt else None)
    monkeypatch.setattr(setup.subprocess, "run", lambda command, **_: ran.append(command))
    with pytest.raises(SystemExit, match="sudo apt-get install libegl1\n"):
        setup.install_packages()
    assert [command[-1] for command in ran] == tried


def test_an_old_python_is_refused(setup: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup.sys, "version_info", (3, 10, 4))
    with pytest.raises(SystemExit, match=r"needs Python 3\.11 or 3\.12, this is 3\.10"):
        setup.check_python()


def test_binder_gets_the_libraries_and_the_torch_that_the_project_names() -> None:
    libraries = (ROOT / "binder" / "apt.txt").read_text().split()
    environment = (ROOT / "environment.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^    sudo apt-get install (.*)$", environment, re.MULTILINE)
    assert set(libraries) == {word for word in line.split() if word.startswith("lib")}
    (torch,) = re.findall(r"torch==[\d.]+", (ROOT / "binder" / "postBuild").read_text())
    assert f'"{torch}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
