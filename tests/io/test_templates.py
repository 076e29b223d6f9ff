"""Compiled templates: used again, renewed with their template, and not written where Python writes no modules."""

import os
import sys
from pathlib import Path

import pytest

from hrsi.hrsi_engine.io.templates import COMPILED, make_environment


@pytest.fixture
def template(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path = tmp_path / "page.j2"
    path.write_text("{{ value | doubled }}", encoding="utf-8")
    return path


def render(folder: Path) -> str:
    environment = make_environment(str(folder), {"doubled": lambda value: 2 * value})
    return str(environment.get_template("page.j2").render(value=21))


def test_a_template_is_compiled_once(template: Path) -> None:
    """A later environment, as in another process, does not compile what has not changed."""
    assert render(template.parent) == "42"
    (compiled,) = (template.parent / COMPILED).iterdir()
    written = compiled.stat().st_mtime_ns, compiled.read_bytes()
    assert render(template.parent) == "42"
    assert (compiled.stat().st_mtime_ns, compiled.read_bytes()) == written
    template.write_text("changed {{ value }}", encoding="utf-8")
    assert render(template.parent) == "changed 21"


def test_a_damaged_compiled_template_is_made_again(template: Path) -> None:
    render(template.parent)
    (compiled,) = (template.parent / COMPILED).iterdir()
    for damage in (b"", compiled.read_bytes()[:30], b"x" * 200):
        compiled.write_bytes(damage)
        assert render(template.parent) == "42"


@pytest.mark.parametrize("way", ["no bytecode", "read-only folder"])
def test_nothing_is_written(template: Path, monkeypatch: pytest.MonkeyPatch, way: str) -> None:
    if way == "no bytecode":
        monkeypatch.setattr(sys, "dont_write_bytecode", True)
    else:  # the tests may run as root, who may write everywhere
        monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert render(template.parent) == "42"
    assert [path.name for path in template.parent.iterdir()] == ["page.j2"]
