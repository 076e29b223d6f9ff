"""`init`: understands the files of a folder, writes a project file, and checks its steps as a run would."""

import os
import shlex

from ..hrsi_engine.foundation.errors import InputError
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.foundation.reasons import Level
from .declarations.projects import InitOptions
from .interface.declare import Context, Report
from .projects.folder_files import read_folder
from .projects.project_file import PROJECT_FILE, check_plan, judge_plan, read_project
from .projects.understanding import understand
from .projects.write_project import describe_folder, write_project

ANSWERS = ("egm96", "ellipsoidal")  #: height datums that the question asks for; the last one's check is reported


def run(options: InitOptions, context: Context) -> Report:
    """Understand the folder, write the project file, and check the plan."""
    path = options.output or os.path.join(options.folder, PROJECT_FILE)
    if os.path.exists(path) and not options.overwrite:
        raise InputError(f"{path} exists: allow `overwrite`, or name another file with `output`")
    advance(context.progress, 0.0, "reading the folder")
    made = understand(read_folder(os.path.abspath(options.folder)), options.height_datum)
    advance(context.progress, 0.6, "checking the steps")
    report: Report = {
        **context.record,
        "project": path,
        "question": made.question,
        "decisions": made.decisions,
        "table": describe_folder(made, os.path.abspath(options.folder)),
        "files": [vars(one) for one in made.roles],
        "map": made.list_map(),
        "steps": {step: {"status": "left out", "told": reason} for step, reason in made.left_out.items()},
    }
    if context.dry_run:
        return {
            **report,
            "dry_run": True,
            "counts": {"files": len(made.roles)},
            "warnings": report["table"],
            "files": [{"path": path, "replaces": os.path.exists(path)}],
            "verdict": {"level": "ok", "sentence": "the folder was read", "reasons": []},
        }
    write_project(made, path)
    report["outputs"] = {"project": path}
    for answer in ANSWERS if made.question else ("",):
        entries = check_plan(read_project(path, answer), context.stage(0.6, 1.0))
        verdict = judge_plan(entries)
        if usable := verdict["level"] != Level.UNUSABLE.label:
            break
    if made.question and usable:
        return report
    report |= {"steps": {**entries, **report["steps"]}, "verdict": verdict, "question": ""}  # no answer would help
    if not usable:
        advice = [one["advice"] for one in verdict["reasons"] if one["level"] == Level.UNUSABLE.label]
        report["unsolved"] = ": ".join([verdict["sentence"], *advice[:1]])
        report["exit_code"] = InputError.exit_code
    return report


def summarise(report: Report) -> str:
    """Return the table of files, the decisions, the steps, and the question or the next command."""
    lines = list(report["table"])
    lines += [f"{step}: {entry['status']}: {entry['told']}" for step, entry in report["steps"].items()]
    if report["question"]:
        return "\n".join([*lines, f"question: {report['question']}"])
    verdict = report["verdict"]
    lines.append(f"checks: {verdict['sentence']}. Verdict of the checks: {verdict['level']}")
    return "\n".join(lines if "unsolved" in report else [*lines, f"next: hrsi run {shlex.quote(report['project'])}"])
