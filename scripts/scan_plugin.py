"""Scan the plugin's zip as the QGIS plugin repository does: ``python scripts/scan_plugin.py [ZIP]``, else a new one.

The repository (https://plugins.qgis.org/docs/security-scanning) unpacks an uploaded zip and runs Bandit and
detect-secrets over all of it; any finding of these blocks the version. It reports what Flake8 finds under some codes,
files that may be executed or are hidden, and kinds of files that do not belong into a plugin. Here Bandit runs with
every test, at every severity and confidence: more than the repository asks. Exit code 1 where anything is found.
"""

import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import make_plugin

#: Codes of Flake8 that the repository has switched on; its lines have 120 characters as ours.
FLAKE8_CODES = (
    "E101,E711,E712,E713,E714,E721,E722,E731,E741,E742,E743,E901,E902,E999,"
    "W605,F402,F403,F404,F405,F811,F821,F822,F823,F831,F901,C901"
)
BARRED_KINDS = {".exe", ".dll", ".so", ".dylib", ".bat", ".sh", ".ps1", ".cmd", ".pyc", ".pyd"}
PICTURES = {".png"}
TRANSLATION = ".qm"  # compiled texts, which Qt reads and nothing runs; their source lies beside
MOST_NOSEC = 3  # each has its reason beside it; more need a better idea first


def run_tool(folder: Path, module: str, *arguments: str) -> str:
    """Run a tool in a folder; return what it printed. Raises RuntimeError where it could not do its work."""
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    if done.returncode not in (0, 1):  # 1: something was found
        raise RuntimeError(f"{module} failed: {done.stderr.strip()}")
    return done.stdout


def bandit_findings(folder: Path) -> tuple[list[str], int]:
    """Return Bandit's findings of every test at every severity, and how many places a ``nosec`` exempts from one."""
    report = json.loads(run_tool(folder, "bandit", "-r", ".", "-f", "json", "--quiet"))
    fields = ("test_id", "issue_severity", "issue_text")
    found = [
        f"{one['filename']}:{one['line_number']}: {' '.join(one[field] for field in fields)}"
        for one in report["results"]
    ]
    found += [f"{error['filename']}: Bandit cannot read it: {error['reason']}" for error in report["errors"]]
    totals = report["metrics"]["_totals"]
    return found, totals["nosec"] + totals["skipped_tests"]


def secret_findings(folder: Path) -> list[str]:
    """Return what detect-secrets takes for a secret, in all files and with all of its detectors."""
    report = json.loads(run_tool(folder, "detect_secrets", "scan", "--all-files", "."))
    return [f"{name}:{one['line_number']}: {one['type']}" for name, found in report["results"].items() for one in found]


def flake8_findings(folder: Path) -> list[str]:
    """Return what Flake8 finds under the codes that the repository has switched on."""
    arguments = ("--isolated", "--max-line-length=120", "--select", FLAKE8_CODES, ".")
    return run_tool(folder, "flake8", *arguments).splitlines()


def file_findings(archive: zipfile.ZipFile) -> list[str]:
    """Return the files of a zip that a plugin must not hold: executable, hidden, binary, outside its folder."""
    found = []
    for entry in archive.infolist():
        path, mode = Path(entry.filename), entry.external_attr >> 16
        if mode & 0o111 or mode & 0o170000 != 0o100000:
            found.append(f"{path}: may be executed, or is no plain file")
        if any(part.startswith((".", "__MACOSX")) or part == "__pycache__" for part in path.parts):
            found.append(f"{path}: is hidden or left behind")
        if path.suffix.lower() in BARRED_KINDS:
            found.append(f"{path}: is of a kind that does not belong into a plugin")
        if path.is_absolute() or ".." in path.parts or path.parts[0] != make_plugin.FOLDER:
            found.append(f"{path}: is outside the plugin's folder")
        if path.suffix not in (*PICTURES, TRANSLATION) and b"\0" in archive.read(entry):
            found.append(f"{path}: is binary")
    return found


def scan(target: Path) -> tuple[dict[str, list[str]], int]:
    """Return the findings of a zip by tool, and how many places are exempt from a test of Bandit."""
    with tempfile.TemporaryDirectory(prefix="hrsi-scan-") as place, zipfile.ZipFile(target) as archive:
        folder = Path(place)
        archive.extractall(folder)
        bandit, exempt = bandit_findings(folder)
        return {
            "bandit": bandit,
            "detect-secrets": secret_findings(folder),
            "flake8": flake8_findings(folder),
            "files": file_findings(archive),
        }, exempt


def main(arguments: list[str]) -> int:
    """Run from the command line."""
    with tempfile.TemporaryDirectory(prefix="hrsi-zip-") as place:
        target = Path(arguments[0]) if arguments else Path(place) / "hrsi.zip"
        if not arguments:
            make_plugin.build(target, {})
        findings, exempt = scan(target)
    for tool, found in findings.items():
        print("\n".join(f"{tool}: {one}" for one in found), end="\n" if found else "")
    counts = ", ".join(f"{tool} {len(found)}" for tool, found in findings.items())
    print(f"plugin zip, findings: {counts}; exempt by nosec: {exempt}")
    return 1 if any(findings.values()) or exempt > MOST_NOSEC else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
