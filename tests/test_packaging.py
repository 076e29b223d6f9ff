"""The package, the plugin and the environment say the same of themselves."""

import ast
import configparser
import importlib.util
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import numpy
import pytest
from parsed_sources import parse_source

from hrsi.hrsi_engine.foundation.version import VERSION
from hrsi.plugin import dependencies
from hrsi.plugin.dependencies import absence_note, missing_package_message


@pytest.fixture(scope="module")
def project(repository: Path) -> dict:
    return tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def metadata(repository: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser()
    parser.read(repository / "metadata.txt", encoding="utf-8")
    return parser["general"]


def test_every_package_is_installed(repository: Path, project: dict):
    """A folder that is missing in pyproject.toml is missing in wheels, though not here."""
    folders = [
        path.parent.relative_to(repository)
        for part in ("hrsi_engine", "plugin", "processing_algorithms")
        for path in (repository / part).rglob("__init__.py")
    ]
    found = {"hrsi"} | {".".join(["hrsi", *folder.parts]) for folder in folders}
    assert set(project["tool"]["setuptools"]["packages"]) == found


def test_every_data_file_is_installed(repository: Path, project: dict):
    patterns = project["tool"]["setuptools"]["package-data"]["*"]
    loose = [
        path.relative_to(repository)
        for part in ("hrsi_engine", "plugin", "processing_algorithms")
        for path in (repository / part).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not any(map(path.match, ["*.py", *patterns]))
    ]
    assert loose == []


def test_versions_agree(repository: Path, metadata: configparser.SectionProxy):
    assert metadata["version"] == VERSION
    assert f"## {VERSION}" in (repository / "CHANGELOG.md").read_text(encoding="utf-8")


def test_plugin_metadata(repository: Path, metadata: configparser.SectionProxy):
    assert metadata["hasProcessingProvider"] == "yes"
    assert (metadata["qgisMinimumVersion"], metadata["qgisMaximumVersion"]) == ("3.22", "4.99")
    assert (repository / metadata["icon"]).is_file()
    assert metadata["experimental"] == "False"
    assert metadata["changelog"].startswith(f"{VERSION}: ")
    assert "supportsQt6" not in metadata  # qgisMaximumVersion says it since QGIS 4


LOADED_BY_AN_OLD_PYTHON = (
    "__init__.py", "plugin/__init__.py", "plugin/old_python.py", "hrsi_engine/__init__.py",
    "hrsi_engine/foundation/__init__.py", "hrsi_engine/foundation/lazy_names.py",
)  # fmt: skip


@pytest.mark.parametrize("name", LOADED_BY_AN_OLD_PYTHON)
def test_what_a_python_that_is_too_old_loads_has_nothing_new(repository: Path, name: str):
    """QGIS for Windows had Python 3.9 up to 3.34.5: there the plugin says so, and fails with no syntax error."""
    tree = ast.parse((repository / name).read_text(encoding="utf-8"), feature_version=(3, 9))
    imports = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level == 0}
    assert imports <= {"__future__", "collections.abc", "importlib", "typing", "qgis.core"}
    assert not [call for call in ast.walk(tree) if isinstance(call, ast.keyword) and call.arg == "strict"]


@pytest.fixture(scope="module")
def make_plugin(repository: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_plugin", repository / "scripts" / "make_plugin.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_plugin_zip_holds_what_the_plugin_repository_wants(repository: Path, make_plugin: ModuleType, tmp_path: Path):
    """One folder named like the plugin, a licence, complete metadata, nothing compiled, nothing of tests, and small."""
    publisher = {
        "email": "a@b.org", "homepage": "https://b.org", "repository": "https://b.org/hrsi",
        "tracker": "https://b.org/hrsi/issues",
    }  # fmt: skip
    make_plugin.build(tmp_path / "hrsi.zip", publisher)
    make_plugin.build(tmp_path / "again.zip", publisher)
    assert (tmp_path / "hrsi.zip").read_bytes() == (tmp_path / "again.zip").read_bytes()
    assert (tmp_path / "hrsi.zip").stat().st_size < 2 * 1024**2
    with zipfile.ZipFile(tmp_path / "hrsi.zip") as archive:
        names = archive.namelist()
        metadata = configparser.ConfigParser()
        metadata.read_string(archive.read("hrsi/metadata.txt").decode())
    assert {name.split("/")[0] for name in names} == {"hrsi"}
    assert {"hrsi/LICENSE", "hrsi/__init__.py", "hrsi/plugin/icons/hrsi.svg"} <= set(names)
    assert not [name for name in names if re.search(r"__pycache__|\.(pyc|so|dll|tif|csv|gpkg)$|/tests/|/\.", name)]
    wanted = (*make_plugin.REQUIRED, *make_plugin.PUBLISHER_FIELDS)
    assert {"about", "author", "email", "repository"} <= set(wanted)
    assert all(metadata["general"][field] for field in wanted)
    sources = {path.relative_to(repository) for path in (repository / "hrsi_engine").rglob("*.py")}
    assert {f"hrsi/{path.as_posix()}" for path in sources} <= set(names)


def test_plugin_zip_is_refused_without_a_required_field(repository: Path, make_plugin: ModuleType, tmp_path: Path):
    with pytest.raises(ValueError, match="about"):
        make_plugin.plugin_metadata(repository, {"about": ""})


def test_plugin_zip_depends_on_its_sources_alone(repository: Path, make_plugin: ModuleType, tmp_path: Path):
    """Times, permissions and what builds leave behind change nothing; a file of another kind is refused by name."""
    zips = []
    for name, mode in (("one", 0o600), ("other", 0o755)):
        root = tmp_path / name
        for path in (*make_plugin.FILES, *(f"{part}/__init__.py" for part in make_plugin.PARTS)):
            copy = root / path
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes((repository / path).read_bytes())
            copy.chmod(mode)
        (root / "plugin" / "__pycache__").mkdir()
        (root / "plugin" / "__pycache__" / f"{name}.cpython-311.pyc").write_bytes(name.encode())
        make_plugin.build(tmp_path / f"{name}.zip", {}, root)
        zips.append((tmp_path / f"{name}.zip").read_bytes())
    assert zips[0] == zips[1]
    for stranger in ("plugin/run.sh", "hrsi_engine/.hidden.py", "plugin/fast.so", "hrsi_engine/block.gpkg"):
        (root / stranger).write_text("")
        with pytest.raises(ValueError, match=f"{stranger} is no file of the plugin"):
            make_plugin.build(tmp_path / "refused.zip", {}, root)
        (root / stranger).unlink()


def test_scan_sees_what_does_not_belong_into_the_zip(tmp_path: Path):
    """Executable, hidden, binary, outside: one finding each, none for the plain file."""
    import scan_plugin

    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name, mode, content in (
            ("hrsi/plain.py", 0o100644, "pass"), ("hrsi/run.py", 0o100755, ""), ("hrsi/link.py", 0o120777, "/etc"),
            ("hrsi/.env", 0o100644, ""), ("hrsi/fast.so", 0o100644, ""), ("hrsi/data.html", 0o100644, "a\0b"),
            ("other/evil.py", 0o100644, ""),
        ):  # fmt: skip
            entry = zipfile.ZipInfo(name)
            entry.external_attr = mode << 16
            archive.writestr(entry, content)
    with zipfile.ZipFile(tmp_path / "bad.zip") as archive:
        found = [line.partition(":")[0] for line in scan_plugin.file_findings(archive)]
    assert found == ["hrsi/run.py", "hrsi/link.py", "hrsi/.env", "hrsi/fast.so", "hrsi/data.html", "other/evil.py"]


def test_scan_sees_faults_of_the_code(tmp_path: Path):
    """Bandit at its lowest severity, detect-secrets and Flake8 run over what is unpacked; `make lint` scans the zip."""
    pytest.importorskip("bandit")
    pytest.importorskip("detect_secrets")
    import scan_plugin

    key = "AKIA" + "QYLPMN5HHHFPZAM2"
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name, content in (
            ("low.py", "assert True\n"), ("secret.txt", f"key = {key}\n"), ("name.py", "print(unknown)\n"),
            ("sql.py", "def drop(cursor, name):\n    cursor.execute(f'DELETE FROM {name}')\n"),
        ):  # fmt: skip
            entry = zipfile.ZipInfo(f"hrsi/{name}")
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, content)
    findings, exempt = scan_plugin.scan(tmp_path / "bad.zip")
    assert [[line.partition(":")[0].removeprefix("./") for line in found] for found in findings.values()] == [
        ["hrsi/low.py", "hrsi/sql.py"], ["hrsi/secret.txt"], ["hrsi/name.py"], []
    ]  # fmt: skip
    assert exempt == 0


def test_constraints_fit_the_dependencies(repository: Path, project: dict):
    """Every package that is pinned is one that we ask for, and none of those that must come from the system."""
    asked = [*project["project"]["dependencies"]]
    for extra in project["project"]["optional-dependencies"].values():
        asked += extra
    names = {re.split(r"[\[<>=~]", requirement)[0].lower() for requirement in asked}
    lines = (repository / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.partition("==")[0].lower() for line in lines if line and not line.startswith("#")}
    assert pinned <= names
    assert not pinned & {"gdal", "rasterio", "pyproj", "shapely"}
    assert not names & {"gdal", "opencv-python", "pyogrio", "fiona"}


def test_modules_open_with_a_docstring(repository: Path):
    silent = [
        path.relative_to(repository)
        for part in ("hrsi_engine", "plugin", "processing_algorithms")
        for path in (repository / part).rglob("*.py")
        if path.stat().st_size and not ast.get_docstring(parse_source(path))
    ]
    assert silent == []


@pytest.mark.parametrize(
    ("package", "advice"),
    [("shapely", "install python3-shapely where your QGIS comes from"), ("cv2", "pip install opencv-python-headless")],
)
def test_advice_on_a_missing_package(package: str, advice: str):
    """A wheel of Shapely would bring a second GEOS into QGIS."""
    message = missing_package_message(ModuleNotFoundError("No module", name=package))
    assert message is not None and re.search(advice, message)
    assert ("pip install" in message) == (package == "cv2")


def test_command_installs_into_the_profile(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """By the interpreter whose library is loaded, not the first on PATH; NumPy keeps its version. Without pip: apt."""
    other = tmp_path / "bin" / "python3"
    other.parent.mkdir()
    other.write_text("#!/bin/sh\n", encoding="utf-8")
    monkeypatch.setenv("PATH", str(other.parent))
    monkeypatch.setattr(sys, "executable", str(other))  # as embedded in QGIS
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    monkeypatch.setattr(dependencies, "_is_missing", lambda package: package in ("cv2", "numba"))
    names, folder = dependencies.list_missing_packages(), dependencies.package_folder(str(tmp_path))
    command = dependencies.install_command(names, folder)
    version = subprocess.run([command[0], "-V"], capture_output=True, text=True, check=True).stdout.split()[1]
    assert version == sys.version.split()[0]
    assert command[1:6] == ["-m", "pip", "install", "--upgrade", "--target"] and str(tmp_path) in command[6]
    assert command[7:] == ["opencv-python-headless", "numba", f"numpy=={numpy.__version__}"]
    monkeypatch.setattr(dependencies, "_is_missing", lambda package: package in ("pip", "cv2", "numba"))
    command = dependencies.install_command(names, folder)
    assert command == ["sudo", "apt-get", "install", "python3-opencv", "python3-numba"]


def test_note_on_a_missing_package(monkeypatch: pytest.MonkeyPatch):
    """Said before anything is run: what every algorithm needs."""
    assert absence_note() == ""
    monkeypatch.setattr(dependencies, "_is_missing", lambda package: package == "shapely")
    assert "install python3-shapely where" in absence_note()
